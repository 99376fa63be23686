"""The measures by name, with their meaning. The unit ends the name: `_s`, `_deg`, otherwise a count."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

MEASURES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "shake_duration_s": "first to last stroke of at least 0.6 g before the press",
        "shake_cycles": "strokes of at least 0.6 g before the press; up and down count as one",
        "shake_to_press_s": "end of shaking to start of the press",
        "exhale_pause_s": "the last still hold, in the hand and not inverted, before the device goes to the mouth",
        "inhalation_start_s": "onset of the held tilt-back at the mouth",
        "inhalation_s": "length of the tilt-back, until it is released or the device leaves the mouth",
        "coordination_s": "start of the press minus start of the inhalation; negative is early",
        "press_count": "presses that reach 60 % of the calibrated travel (not calibrated: 5 deg)",
        "partial_press_count": "presses below that, down to 15 % (not calibrated: 1.5 deg)",
        "press_angle_deg": "largest lever angle of the dose",
        "tilt_at_press_deg": "tilt from upright at the end stop of the press",
        "breath_hold_s": "end of the inhalation to exhalation or the next large motion",
        "tilt_at_inhalation_deg": "tilt from upright while inhaling, 95th percentile",
        "cover_angle_max_deg": "largest cover angle",
        "cover_final_deg": "cover angle at the end",
        "cover_openings": "full openings of the cover before inhaling",
        "shake_after_open_cycles": "strokes of at least 0.6 g between opening and inhaling, two a cycle",
        "tilt_after_open_max_deg": "largest tilt from upright between opening and inhaling",
        "inverted_after_open_s": "time upside down between opening and inhaling",
        "open_to_inhale_s": "opening to inhalation",
        "order_violations": "steps out of the device's order",
        "puff_interval_s": "time between this dose and the one before",
    }
)

# For the rules alone; not written in reports.
INTERNAL_MEASURES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "mouth_stays": "stays at the mouth of any kind",
        "press_after_mouth_s": "start of the press minus the moment the device left the mouth; positive is after",
    }
)


def unit_of(measure: str) -> str:
    """`s`, `deg` or `count`, from the measure's name."""
    if measure.endswith("_deg"):
        return "deg"
    return "s" if measure.endswith("_s") else "count"
