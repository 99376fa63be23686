"""Presses, openings and closings, against angles in closed form and simulated truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import least_jerk, scored, still, with_lever, with_pulses

import inhalemon as im
from inhalemon.devices import load_device
from inhalemon.stages.events import find_events
from inhalemon.values import EventKind, Shake

PMDI, ELLIPTA = load_device("pmdi"), load_device("ellipta")


def rad(deg: float) -> float:
    return math.radians(deg)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("rise_s", [0.08, 0.2, 0.5])
def test_a_press_is_found_where_it_begins_and_stops(rate_hz, rise_s):
    """Within 40 ms: the first and last hundredth of a least-jerk course takes a tenth of its time each."""
    motion = with_pulses(still(6.0, rate_hz), (2.0, rise_s, 0.4, 0.2, rad(12.0)))
    (press,) = find_events(motion, (), PMDI)
    assert press.kind is EventKind.PRESS
    assert press.start_s == pytest.approx(2.0, abs=0.04)
    assert press.peak_s == pytest.approx(2.0 + rise_s, abs=max(0.04, 0.2 * rise_s))
    assert press.end_s == pytest.approx(2.6 + rise_s, abs=0.06)
    assert press.angle_deg == pytest.approx(12.0, abs=0.3)


def test_a_press_below_the_full_stroke_is_partial():
    (press,) = find_events(with_pulses(still(6.0), (2.0, 0.2, 0.4, 0.2, rad(3.0))), (), PMDI)
    assert press.kind is EventKind.PARTIAL_PRESS
    calibrated = replace(PMDI, full_travel_rad=rad(4.0))
    (press,) = find_events(with_pulses(still(6.0), (2.0, 0.2, 0.4, 0.2, rad(3.0))), (), calibrated)
    assert press.kind is EventKind.PRESS


def test_two_presses_are_two():
    motion = with_pulses(still(8.0), (2.0, 0.2, 0.3, 0.2, rad(12.0)), (3.5, 0.2, 0.3, 0.2, rad(11.0)))
    assert [event.kind for event in find_events(motion, (), PMDI)] == [EventKind.PRESS, EventKind.PRESS]


@pytest.mark.parametrize(
    ("course", "why"),
    [
        (lambda t: rad(15.0) * t / 10.0, "drift of 1.5 deg/s"),
        (lambda t: rad(0.6) * np.sin(2 * np.pi * t), "play of the lever"),
        (lambda t: np.full(t.size, rad(30.0)), "a zero that is off"),
    ],
)
def test_what_is_no_press_is_none(course, why):
    motion = still(10.0)
    assert find_events(with_lever(motion, course(motion.time_s)), (), PMDI) == (), why


def test_the_angle_of_a_press_is_told_against_the_angle_just_before():
    motion = with_pulses(still(10.0), (5.0, 0.2, 0.4, 0.2, rad(12.0)))
    (press,) = find_events(with_lever(motion, motion.lever_rad + rad(1.0) * motion.time_s), (), PMDI)
    assert press.angle_deg == pytest.approx(12.0, abs=0.8)  # half a second of drift at 1 deg/s


def test_trembling_of_the_angle_while_shaking_is_no_press():
    motion = still(10.0)
    tremble = np.where(np.abs(motion.time_s - 3.5) < 1.5, rad(3.0) * np.sin(2 * np.pi * 4 * motion.time_s), 0)
    strokes = np.arange(2.0, 5.0, 0.125)
    shake = Shake(strokes, strokes + 0.125, 0.4)
    assert find_events(with_lever(motion, tremble), (shake,), PMDI) == ()


def test_an_angle_that_sinks_while_the_lever_is_held_is_no_release():
    """By 1.6 deg, as across a gap in the samples."""
    motion = with_pulses(still(6.0), (2.0, 0.2, 1.2, 0.2, rad(12.0)))
    (press,) = find_events(with_lever(motion, motion.lever_rad - rad(1.6) * sunk(motion.time_s, 2.7, 3.4)), (), PMDI)
    assert press.end_s == pytest.approx(3.6, abs=0.06)
    assert press.angle_deg == pytest.approx(12.0, abs=0.3)


def sunk(time_s, from_s, to_s):
    return least_jerk(time_s, from_s, 0.1) - least_jerk(time_s, to_s, 0.2)


def test_a_press_that_the_recording_does_not_see_released_is_a_press():
    motion = with_pulses(still(4.0), (3.0, 0.2, 5.0, 0.2, rad(12.0)))
    (press,) = find_events(motion, (), PMDI)
    assert press.end_s == motion.time_s[-1]


@pytest.mark.parametrize("largest_deg", [50.0, 95.0])
def test_a_cover_opens_and_shuts(largest_deg):
    """Begun to 30 ms, three samples; stopped to a fifth of the stroke's time, whose last part is slower than drift."""
    motion = with_pulses(still(10.0), (2.0, 0.8, 3.0, 0.9, rad(largest_deg)))
    opened, shut = find_events(motion, (), ELLIPTA)
    assert (opened.kind, shut.kind) == (EventKind.OPEN, EventKind.CLOSE)
    assert opened.start_s == pytest.approx(2.0, abs=0.03)
    assert opened.peak_s == pytest.approx(2.8, abs=0.16)
    assert opened.angle_deg == pytest.approx(largest_deg, rel=0.01)
    assert shut.start_s == pytest.approx(5.8, abs=0.03)


def test_a_cover_that_springs_back_from_its_end_stop_has_opened_when_it_rests():
    motion = with_pulses(still(10.0), (2.0, 0.8, 4.0, 0.9, rad(95.0)))
    sprung = with_lever(motion, motion.lever_rad - rad(4.0) * sunk(motion.time_s, 2.85, 6.8))
    opened, _ = find_events(sprung, (), ELLIPTA)
    assert opened.peak_s == pytest.approx(2.8, abs=0.1)
    assert opened.end_s == pytest.approx(2.95, abs=0.06)
    assert opened.angle_deg == pytest.approx(95.0, rel=0.01)


def test_a_cover_that_never_moves_has_no_events():
    assert find_events(still(6.0), (), ELLIPTA) == ()


def test_a_plain_hinge_has_no_events():
    motion = with_pulses(still(6.0), (2.0, 0.2, 0.4, 0.2, rad(40.0)))
    assert find_events(motion, (), load_device("hinge")) == ()


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize(("device", "kind"), [("pmdi", EventKind.PRESS), ("ellipta", EventKind.OPEN)])
def test_simulated_strokes_are_found_at_every_rate(device, kind, rate_hz):
    report, truth = scored(device, seed=41, rate_hz=rate_hz)
    found, acted = ([event for event in of.events if event.kind is kind] for of in (report, truth))
    assert len(found) == len(acted)
    for event, true in zip(found, acted, strict=True):
        assert event.start_s == pytest.approx(true.start_s, abs=0.06)
        assert event.angle_deg == pytest.approx(true.angle_deg, abs=2.0)


def test_a_weak_press_is_partial_and_a_second_one_is_counted():
    weak, _ = scored("pmdi", ("press_incomplete",), seed=42)
    assert weak.measures["press_count"].value == 0
    assert weak.measures["partial_press_count"].value >= 1
    twice, truth = scored("pmdi", ("multiple_presses",), seed=42)
    assert twice.measures["press_count"].value == truth.measures["press_count"] >= 2


def test_events_are_the_same_when_the_session_is_scored_again():
    recording, _ = im.simulate_session("pmdi", seed=43)
    assert im.score_recording(recording).events == im.score_recording(recording).events
