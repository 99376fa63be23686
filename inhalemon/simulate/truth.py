"""The truth of a simulated session: what was acted, as labels, and the exact tracks."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from inhalemon.formats import LABELS_FORMAT
from inhalemon.recording.layout import stem_of
from inhalemon.rotation import tilt_from_upright
from inhalemon.simulate.sensors import Clock
from inhalemon.simulate.steps import DoseNotes
from inhalemon.values import STANDARD_GRAVITY_M_S2, DeviceKind, Event, EventKind, FloatArray, IntArray, Phase

_STROKE_M_S2: Final = 0.6 * STANDARD_GRAVITY_M_S2
_FULL_OPENING: Final = 0.85  # of the cover's travel
_MIN_STROKES: Final = 4  # fewer are bumps


class ExactMotion(Protocol):
    """What the truth needs of a motion, whoever made it."""

    def attitude(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`q_ref_body` (n, 4) and the lever's angle (n,)."""

    def acceleration(self, time_s: FloatArray) -> FloatArray:
        """Acceleration of the body's chip in the room (n, 3), gravity not included."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What really happened. Times are on the body sensor's clock; `time_s` are the body track's own times."""

    session_id: str
    device: DeviceKind
    mistakes: tuple[str, ...]
    phases: tuple[Phase, ...]
    events: tuple[Event, ...]
    measures: Mapping[str, float | None]  # of the first dose
    time_s: FloatArray  # (n,)
    q_ref_body: FloatArray  # (n, 4)
    angle_rad: FloatArray  # (n,) of the lever or cover
    tilt_rad: FloatArray  # (n,) of the body from upright
    lever_time_s: FloatArray  # (m,) the lever track's own times, on its own clock
    q_ref_lever: FloatArray  # (m, 4) at the lever's rows
    lever_clock: Clock  # t_lever = offset_s + (1 + drift) t_body
    gyr_bias_body_rad_s: FloatArray  # (n, 3)
    gyr_bias_lever_rad_s: FloatArray  # (m, 3)
    travel_rad: float  # the lever's or cover's full travel

    def to_labels(self) -> dict[str, object]:
        """The labels as JSON values, `inhalemon-labels/1`."""
        return {
            "format": LABELS_FORMAT,
            "session_id": self.session_id,
            "device": self.device.value,
            "mistakes": list(self.mistakes),
            "phases": [{"kind": p.kind.value, "start_s": _r(p.start_s), "end_s": _r(p.end_s)} for p in self.phases],
            "events": [
                {
                    "kind": e.kind.value,
                    "start_s": _r(e.start_s),
                    "peak_s": _r(e.peak_s),
                    "end_s": _r(e.end_s),
                    "angle_deg": _r(e.angle_deg),
                }
                for e in self.events
            ],
            "measures": {name: None if value is None else _r(value) for name, value in self.measures.items()},
        }

    def write_labels(self, path: str | Path) -> Path:
        """Writes the labels beside a recording: `<stem>.truth.json` for any path of the recording."""
        path = Path(path)
        target = path.with_name(stem_of(path.name) + ".truth.json")
        target.write_text(json.dumps(self.to_labels(), indent=1) + "\n", encoding="utf-8")
        return target


def _r(value: float) -> float:
    return round(float(value), 5)


def strokes(motion: ExactMotion, start_s: float, end_s: float) -> FloatArray:
    """Start and end (k, 2) of each half wave of acceleration that reaches 0.6 g along the main direction."""
    time_s = np.arange(start_s, end_s, 1 / 400)
    acc = motion.acceleration(time_s)
    _, _, directions = np.linalg.svd(acc, full_matrices=False)
    along = acc @ directions[0]
    turns: IntArray = np.flatnonzero(np.diff(np.signbit(along))) + 1
    edges = np.concatenate([[0], turns, [along.size]])
    found = [
        (time_s[i], time_s[min(j, time_s.size - 1)])
        for i, j in itertools.pairwise(edges)
        if np.abs(along[i:j]).max() >= _STROKE_M_S2
    ]
    return np.array(found).reshape(-1, 2)


def dose_measures(
    device: DeviceKind,
    notes: DoseNotes,
    motion: ExactMotion,
    shakes: Sequence[tuple[float, float]],
    *,
    full_travel_rad: float,
    final_s: float,
) -> dict[str, float | None]:
    """The measures of one dose, each as the report defines it, from what was acted and the exact motion."""
    begin, end = notes.inhalation_start_s, notes.inhalation_end_s
    measures: dict[str, float | None] = {
        "exhale_pause_s": _difference(notes.pause_end_s, notes.pause_start_s),
        "inhalation_start_s": begin,
        "inhalation_s": _difference(end, begin),
        "breath_hold_s": _difference(notes.hold_end_s, end),
        "tilt_at_inhalation_deg": None,
        "order_violations": float(notes.n_order_violations),
    }
    if notes.tilted_s is not None and end is not None:
        tilt = _tilt_deg(motion, notes.tilted_s, end)
        measures["tilt_at_inhalation_deg"] = float(np.percentile(tilt, 95))
    shakes = [s for s in shakes if notes.start_s <= s[0] < notes.end_s]
    if device is DeviceKind.PMDI:
        return measures | _pmdi_measures(notes, motion, shakes)
    return measures | _ellipta_measures(notes, motion, shakes, full_travel_rad, final_s)


def _pmdi_measures(
    notes: DoseNotes, motion: ExactMotion, shakes: Sequence[tuple[float, float]]
) -> dict[str, float | None]:
    presses = [e for e in notes.presses if e.kind is EventKind.PRESS]
    first = min(notes.presses, key=lambda e: e.start_s, default=None)
    largest = max(notes.presses, key=lambda e: e.angle_deg, default=None)
    found = [s for start_s, end_s in shakes for s in strokes(motion, start_s, end_s)]
    is_shaken = len(found) >= _MIN_STROKES
    shake_end_s = float(found[-1][1]) if is_shaken else None
    return {
        "shake_duration_s": float(found[-1][1] - found[0][0]) if is_shaken else 0.0,
        "shake_cycles": len(found) / 2 if is_shaken else 0.0,
        "shake_to_press_s": _difference(first.start_s if first else None, shake_end_s),
        "coordination_s": _difference(first.start_s if first else None, notes.inhalation_start_s),
        "press_count": float(len(presses)),
        "partial_press_count": float(len(notes.presses) - len(presses)),
        "press_angle_deg": largest.angle_deg if largest else None,
        "tilt_at_press_deg": float(_tilt_deg(motion, largest.peak_s)[0]) if largest else None,
    }


def _ellipta_measures(
    notes: DoseNotes,
    motion: ExactMotion,
    shakes: Sequence[tuple[float, float]],
    full_travel_rad: float,
    final_s: float,
) -> dict[str, float | None]:
    full_deg = np.rad2deg(full_travel_rad)
    final_deg = float(np.rad2deg(motion.attitude(np.array([final_s]))[1][0]))
    measures: dict[str, float | None] = {
        "cover_angle_max_deg": max((e.angle_deg for e in notes.openings), default=0.0),
        "cover_final_deg": final_deg,
        "cover_openings": float(sum(e.angle_deg >= _FULL_OPENING * full_deg for e in notes.openings)),
        "shake_after_open_cycles": None,
        "tilt_after_open_max_deg": None,
        "inverted_after_open_s": None,
        "open_to_inhale_s": None,
    }
    if notes.inhalation_start_s is not None and notes.openings:
        opened_s, begin = notes.openings[-1].peak_s, notes.inhalation_start_s
        tilt = _tilt_deg(motion, opened_s, begin)
        found = [s for start_s, end_s in shakes if start_s >= opened_s for s in strokes(motion, start_s, end_s)]
        measures["shake_after_open_cycles"] = len(found) / 2
        measures["tilt_after_open_max_deg"] = float(tilt.max())
        measures["inverted_after_open_s"] = float(np.mean(tilt > 90.0) * (begin - opened_s))
        measures["open_to_inhale_s"] = begin - opened_s
    return measures


def _difference(later: float | None, earlier: float | None) -> float | None:
    return None if later is None or earlier is None else later - earlier


def _tilt_deg(motion: ExactMotion, start_s: float, end_s: float | None = None) -> FloatArray:
    time_s = np.array([start_s]) if end_s is None else np.arange(start_s, end_s, 0.01)
    return np.rad2deg(tilt_from_upright(motion.attitude(time_s)[0]))
