"""Measures, against phases and events that were put there by hand, and simulated truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import scored, still

import inhalemon as im
from inhalemon.devices import load_device
from inhalemon.stages.measures import measure_dose
from inhalemon.values import DeviceKind, Event, EventKind, Motion, Phase, PhaseKind, Shake

PMDI, ELLIPTA = load_device("pmdi"), load_device("ellipta")
SPAN = (0.0, 30.0)
STROKES_S = 3.0 + 0.125 * np.arange(24)
SHAKE = Shake(STROKES_S, STROKES_S + 0.125, 0.4)  # 3 to 6 s, 12 cycles
PHASES = (
    Phase(PhaseKind.REST, 0.0, 3.0),
    Phase(PhaseKind.SHAKE, 3.0, 6.0),
    Phase(PhaseKind.HANDLING, 6.0, 7.0),
    Phase(PhaseKind.EXHALE, 7.0, 9.0),
    Phase(PhaseKind.TO_MOUTH, 9.0, 10.0),
    Phase(PhaseKind.INHALE, 10.0, 13.5),
    Phase(PhaseKind.BREATH_HOLD, 13.5, 18.5),
    Phase(PhaseKind.EXHALE_AFTER, 18.5, 20.0),
    Phase(PhaseKind.PUT_DOWN, 20.0, 22.0),
    Phase(PhaseKind.REST, 22.0, 30.0),
)


def press(start_s: float, angle_deg: float = 12.0, kind: EventKind = EventKind.PRESS) -> Event:
    return Event(kind, start_s, start_s + 0.2, start_s + 0.8, angle_deg)


PRESSES = (press(10.3),)


def cover(kind: EventKind, start_s: float, angle_deg: float = 95.0) -> Event:
    return Event(kind, start_s, start_s + 0.8, start_s + 0.8, angle_deg)


def measured(motion: Motion | None = None, events=PRESSES, phases=PHASES, shakes=(SHAKE,), device=PMDI, **more):
    return measure_dose(motion or still(30.0), phases, shakes, events, device, SPAN, **more)


def test_times_between_steps_are_their_differences():
    m = measured()
    assert m["shake_duration_s"].value == pytest.approx(3.0)
    assert m["shake_cycles"].value == 12.0
    assert m["shake_to_press_s"].value == pytest.approx(4.3)
    assert m["exhale_pause_s"].value == pytest.approx(2.0)
    assert m["inhalation_start_s"].value == pytest.approx(10.0)
    assert m["inhalation_s"].value == pytest.approx(3.5)
    assert m["coordination_s"].value == pytest.approx(0.3)
    assert m["breath_hold_s"].value == pytest.approx(5.0)
    assert m["order_violations"].value == 0.0
    assert all(measure.sd is None or measure.sd >= 0.0 for measure in m.values())


def test_shaking_lasts_from_the_first_to_the_last_stroke_whatever_lies_between():
    first, again = (
        Shake(start_s + STROKES_S[:4] - 3.0, start_s + STROKES_S[:4] - 2.875, 0.4) for start_s in (3.0, 8.0)
    )
    m = measured(shakes=(first, again))
    assert m["shake_duration_s"].value == pytest.approx(again.end_s - first.start_s)
    assert m["shake_duration_s"].value == pytest.approx(5.5)
    assert m["shake_cycles"].value == 4.0


def test_a_press_before_the_inhalation_is_negative():
    assert measured(events=(press(9.0),))["coordination_s"].value == pytest.approx(-1.0)


def test_presses_are_counted_by_kind_and_the_largest_is_told():
    m = measured(events=(press(9.8, 3.0, EventKind.PARTIAL_PRESS), press(10.3, 11.0), press(11.5, 14.0)))
    assert (m["press_count"].value, m["partial_press_count"].value) == (2.0, 1.0)
    assert m["press_angle_deg"].value == 14.0


def test_tilts_are_those_of_the_moment_they_speak_of():
    """Upright but for 30 degrees while inhaling and 50 at the press."""
    motion = still(30.0)
    tilt = np.zeros(motion.time_s.size)
    tilt[1000:1350] = math.radians(30.0)
    tilt[1040:1060] = math.radians(50.0)
    m = measured(replace(motion, tilt_rad=tilt))
    assert m["tilt_at_press_deg"].value == pytest.approx(50.0)
    assert m["tilt_at_inhalation_deg"].value == pytest.approx(30.0)


@pytest.mark.parametrize(
    ("changed", "missing", "reason"),
    [
        ({"events": ()}, ("coordination_s", "press_angle_deg", "tilt_at_press_deg", "shake_to_press_s"), "no_press"),
        ({"shakes": ()}, ("shake_to_press_s",), "not_shaken"),
        (
            {"phases": (Phase(PhaseKind.HANDLING, *SPAN),)},
            ("inhalation_start_s", "inhalation_s", "breath_hold_s", "exhale_pause_s", "coordination_s"),
            "no_inhalation_seen",
        ),
        (
            {"phases": (Phase(PhaseKind.HANDLING, 0.0, 9.0), Phase(PhaseKind.TO_MOUTH, 9.0, 14.0))},
            ("inhalation_start_s", "inhalation_s", "coordination_s"),
            "no_tilt_back_seen",
        ),
    ],
)
def test_a_measure_that_cannot_be_had_says_why(changed, missing, reason):
    m = measured(**changed)
    assert {name: (m[name].value, m[name].reason) for name in missing} == dict.fromkeys(missing, (None, reason))


def test_what_the_recording_does_not_see_the_end_of_has_no_length():
    phases = (*PHASES[:5], Phase(PhaseKind.INHALE, 10.0, 29.99))
    m = measured(phases=phases)
    assert m["inhalation_s"].reason == m["breath_hold_s"].reason == "recording_ended_before"


def test_no_hold_after_the_inhalation_is_a_hold_of_nothing():
    phases = (*PHASES[:6], Phase(PhaseKind.HANDLING, 13.5, 30.0))
    assert measured(phases=phases)["breath_hold_s"].value == 0.0


def test_a_breath_whose_end_no_stillness_shows_is_less_sure():
    """Of 4 s of moving the first 0.7 take the device away; with little stillness after, the breath goes in the rest."""
    phases = (*PHASES[:7], Phase(PhaseKind.HANDLING, 18.5, 20.0), *PHASES[8:])
    motion = still(30.0)
    moving = replace(motion, activity=np.where((motion.time_s > 13.5) & (motion.time_s < 17.5), 5.0, 0.0))
    sure, unsure = measured(phases=phases)["breath_hold_s"], measured(moving, phases=phases)["breath_hold_s"]
    assert sure.value == pytest.approx(5.0)
    assert sure.sd < 0.3
    assert unsure.value == pytest.approx(0.5 * (0.7 + 4.0), abs=0.02)
    assert unsure.sd == pytest.approx(math.hypot(0.2, 3.3 / math.sqrt(12.0)), abs=0.01)


def test_an_inhalation_that_seems_to_begin_on_the_way_is_less_sure():
    motion = still(30.0)
    on_the_way = np.where(np.abs(motion.time_s - 10.0) < 0.5, 0.4, 0.0)
    carried = replace(motion, velocity_ref_m_s=np.stack([on_the_way, 0 * on_the_way, 0 * on_the_way], axis=1))
    for name in ("inhalation_start_s", "coordination_s", "inhalation_s"):
        assert measured(carried)[name].sd >= 0.3
        assert measured()[name].sd < 0.1


def test_of_presses_that_cannot_be_told_apart_the_first_is_the_largest():
    assert measured(events=(press(10.3, 12.0), press(11.5, 12.3)))["press_angle_deg"].start_s == pytest.approx(10.3)
    assert measured(events=(press(10.3, 12.0), press(11.5, 13.5)))["press_angle_deg"].start_s == pytest.approx(11.5)


@pytest.mark.parametrize(("length_s", "is_told"), [(0.2, True), (0.8, False)])
def test_a_measure_over_a_gap_is_given_only_when_the_gap_is_short(length_s, is_told):
    motion = still(30.0)
    is_gap = (motion.time_s > 15.0) & (motion.time_s < 15.0 + length_s)
    m = measured(replace(motion, is_gap=is_gap))
    assert (m["breath_hold_s"].value is not None) == is_told
    assert m["breath_hold_s"].reason == ("crosses_a_gap" if is_told else "gap_in_the_recording")
    assert m["inhalation_s"].reason is None


def test_a_gap_at_a_boundary_makes_the_measure_less_sure():
    """The boundary may lie anywhere in the gap, on either side: half the length of all of it, and no less."""
    motion = still(30.0)
    m = measured(replace(motion, is_gap=(motion.time_s > 13.3) & (motion.time_s < 13.7)))
    assert m["breath_hold_s"].sd >= 0.19
    assert m["breath_hold_s"].sd > measured()["breath_hold_s"].sd


def test_the_interval_of_two_puffs_is_between_their_starts():
    assert measured()["puff_interval_s"].reason == "first_dose"
    assert measured(earlier_inhalation_s=-50.0)["puff_interval_s"].value == pytest.approx(60.0)


# ------------------------------------------------------------------------------------------------------ the cover's


def ellipta(events, motion: Motion | None = None, shakes=()):
    return measured(motion, events, shakes=shakes, device=ELLIPTA)


def test_the_covers_measures_are_those_of_its_strokes():
    m = ellipta((cover(EventKind.OPEN, 4.0), cover(EventKind.CLOSE, 20.5)))
    assert m["cover_angle_max_deg"].value == pytest.approx(95.0)
    assert m["cover_openings"].value == 1.0
    assert m["open_to_inhale_s"].value == pytest.approx(10.0 - 4.8)
    assert m["cover_final_deg"].value == pytest.approx(0.0)
    assert m["shake_after_open_cycles"].value == 0.0
    assert m["inverted_after_open_s"].value == 0.0


def test_only_full_openings_before_inhaling_are_counted():
    opens = [cover(EventKind.OPEN, at, deg) for at, deg in ((4.0, 95.0), (6.0, 40.0), (8.0, 95.0), (25.0, 95.0))]
    assert ellipta(opens)["cover_openings"].value == 2.0


def test_what_is_done_to_an_open_device_is_measured():
    """Shaken for 12 cycles and upside down for a second after it was opened."""
    motion = still(30.0)
    tilt = np.where((motion.time_s >= 7.0) & (motion.time_s < 8.0), math.radians(120.0), 0.0)
    m = ellipta((cover(EventKind.OPEN, 1.0),), replace(motion, tilt_rad=tilt), shakes=(SHAKE,))
    assert m["shake_after_open_cycles"].value == 12.0
    assert m["inverted_after_open_s"].value == pytest.approx(1.0, abs=0.02)
    assert m["tilt_after_open_max_deg"].value == pytest.approx(120.0)


def test_shutting_before_inhaling_is_out_of_order():
    m = ellipta((cover(EventKind.OPEN, 4.0), cover(EventKind.CLOSE, 8.0)))
    assert m["order_violations"].value == 1.0


def test_opening_again_before_inhaling_is_in_order():
    strokes = (cover(EventKind.OPEN, 2.0), cover(EventKind.CLOSE, 4.0), cover(EventKind.OPEN, 6.0))
    assert ellipta(strokes)["order_violations"].value == 0.0


@pytest.mark.parametrize(("stroke_s", "count"), [(3.0, 0.0), (9.5, 1.0)])
def test_shaking_at_the_mouth_is_out_of_order(stroke_s, count):
    shake = Shake(STROKES_S[:4] - 3.0 + stroke_s, STROKES_S[:4] - 2.875 + stroke_s, 0.4)
    assert measured(shakes=(shake,))["order_violations"].value == count


def test_the_order_is_that_of_the_devices_profile():
    """Shaking after the press where the profile says so; and no order where it says none."""
    late = replace(PMDI, steps=(PhaseKind.TO_MOUTH, PhaseKind.INHALE, PhaseKind.SHAKE))
    assert measured(device=late)["order_violations"].value == 1.0
    shake = Shake(STROKES_S + 8.0, STROKES_S + 8.125, 0.4)
    assert measured(device=late, shakes=(shake,))["order_violations"].value == 0.0
    early_press = (press(2.0), press(10.3))
    assert measured(events=early_press)["order_violations"].value == 1.0
    assert measured(events=early_press, device=replace(PMDI, steps=()))["order_violations"].value == 0.0


# -------------------------------------------------------------------------------------------------- simulated truth

# Physical: a boundary within 100-150 ms, an angle of the device in the room within what a chip's mounting allows.
WITHIN = {
    "inhalation_start_s": 0.10,
    "inhalation_s": 0.20,
    "coordination_s": 0.12,
    "breath_hold_s": 0.35,
    "exhale_pause_s": 0.35,
    "press_angle_deg": 1.5,
    "tilt_at_press_deg": 6.0,
    "tilt_at_inhalation_deg": 6.0,
    "cover_angle_max_deg": 4.0,
    "cover_final_deg": 4.0,
    "open_to_inhale_s": 0.25,
}


@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_measures_of_a_simulated_session_are_what_was_acted(device, seed):
    report, truth = scored(device, seed=seed)
    for name, tolerance in WITHIN.items():
        if name in report.measures and truth.measures.get(name) is not None:
            assert report.measures[name].value == pytest.approx(truth.measures[name], abs=tolerance), name


def test_a_plain_hinge_has_no_measures():
    recording, _ = im.simulate_session("pmdi", seed=73)
    report = im.score_recording(replace(recording, device=DeviceKind.HINGE))
    assert report.measures == {}
    assert report.doses == ()
    assert report.phases == ()
