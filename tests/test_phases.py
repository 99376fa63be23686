"""Phases: what must hold of any session, and simulated truth."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import check_phases, cut, least_jerk, overlap, scored, still, with_lever, without

import inhalemon as im
from inhalemon.devices import load_device
from inhalemon.report import to_json
from inhalemon.settings import PhaseSettings
from inhalemon.simulate import MISTAKES
from inhalemon.stages.phases import find_phases
from inhalemon.stages.phases.order import LABELS, cheapest_path, transition_costs
from inhalemon.values import Event, EventKind, PhaseKind, Report, Shake
from validation.second_actor import ATTACKS
from validation.second_generator import second_session

DEVICES = ("pmdi", "ellipta")
PMDI = load_device("pmdi")


def first(report: Report, kind: PhaseKind):
    return next((phase for phase in report.phases if phase.kind is kind), None)


# ------------------------------------------------------------------------------------------------ the cheapest path


def _cost(path, costs, transitions) -> float:
    steps = sum(transitions[a, b] for a, b in pairwise(path))
    return float(steps + sum(costs[k, label] for k, label in enumerate(path)))


@given(st.integers(0, 10_000), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_no_path_is_cheaper_than_the_cheapest(seed, m):
    """Against every path there is, over three labels."""
    rng = np.random.default_rng(seed)
    costs, transitions = rng.uniform(0, 3, (m, 3)), rng.uniform(0, 2, (3, 3))
    found = cheapest_path(costs, transitions)
    least = min(_cost(path, costs, transitions) for path in product(range(3), repeat=m))
    assert _cost(found.tolist(), costs, transitions) == pytest.approx(least)


def test_leaving_the_order_of_the_steps_costs_more_than_keeping_it():
    costs = transition_costs(PMDI.steps, PhaseSettings())
    at = {kind: k for k, kind in enumerate(LABELS)}
    onward = costs[at[PhaseKind.SHAKE], at[PhaseKind.EXHALE]]
    assert onward < costs[at[PhaseKind.SHAKE], at[PhaseKind.INHALE]]  # a step left out
    assert onward < costs[at[PhaseKind.EXHALE], at[PhaseKind.SHAKE]]  # a step back
    assert not np.diag(costs).any()
    # A breath is held only after it was drawn.
    assert costs[at[PhaseKind.SHAKE], at[PhaseKind.BREATH_HOLD]] > 1e3


# ----------------------------------------------------------------------------------------- what holds of any session


@given(st.integers(0, 2**31), st.sampled_from(DEVICES), st.sampled_from(["typical", "harsh"]), st.data())
@settings(max_examples=8, deadline=None, derandomize=True)
def test_phases_cover_any_session_without_overlap(seed, device, profile, data):
    mistake = data.draw(st.sampled_from([None, *MISTAKES[device]]))
    recording, _ = im.simulate_session(device, [mistake] if mistake else [], seed=seed, profile=profile)
    report = im.score_recording(recording)
    check_phases(report)
    assert to_json(im.score_recording(recording)) == to_json(report)  # to the bit


@pytest.mark.parametrize("attack", ATTACKS)
def test_phases_cover_the_second_generators_sessions(attack):
    recording, _ = second_session(DEVICES[len(attack) % 2], seed=61, attack=attack)
    check_phases(im.score_recording(recording))


@pytest.mark.parametrize(("device", "rate_hz"), [("pmdi", 37.0), ("ellipta", 200.0)])
def test_phases_and_doses_reach_from_the_first_sample_to_the_last(device, rate_hz):
    recording, _ = im.simulate_session(device, seed=3, rate_hz=rate_hz)
    report = im.score_recording(recording)
    ends_s = recording.body.time_s[[0, -1]].tolist()
    for parts in (report.phases, report.doses):
        assert [parts[0].start_s, parts[-1].end_s] == pytest.approx(ends_s, abs=1e-9)
    assert report.duration_s == pytest.approx(ends_s[1] - ends_s[0], abs=1e-9)


def test_a_device_that_never_moves_is_only_handled_or_at_rest():
    """Nothing is inhaled, shaken or opened by a device that stands still; nor does k-means warn of equal windows."""
    for device in DEVICES:
        kinds = {phase.kind for phase in find_phases(still(20.0), (), (), load_device(device))}
        assert kinds <= {PhaseKind.REST, PhaseKind.HANDLING}


def _lifted(*visits: tuple[float, float, float], duration_s: float = 20.0):
    """A trembling hand that lifts the device within 1 s, and 5 s later lowers it.

    Of each visit: when it begins, how many metres up, and after how long the device is tilted back by 25 deg.
    """
    motion = still(duration_s)
    time_s = motion.time_s
    tilt, height = np.zeros((2, time_s.size))
    for start_s, lift_m, tilted_s in visits:
        down = least_jerk(time_s, start_s + 5.0, 0.8)
        tilt += np.radians(25.0) * (least_jerk(time_s, start_s + tilted_s, 0.8) - down) * (tilted_s < 5.0)
        height += lift_m * (least_jerk(time_s, start_s, 1.0) - down)
    tremor = np.sin(2.0 * np.pi * 8.0 * time_s)[:, None] * np.ones(3)
    gyr = 0.03 * tremor
    gyr[:, 0] += np.gradient(tilt, motion.step_s)
    velocity = np.zeros((time_s.size, 3))
    velocity[:, 2] = np.gradient(height, motion.step_s)
    return replace(
        motion,
        tilt_rad=tilt,
        elevation_rad=tilt,
        gyr_rad_s=gyr,
        force_m_s2=motion.force_m_s2 + 0.2 * tremor,
        velocity_ref_m_s=velocity,
        height_m=height,
    )


_NEVER_S = 9.0
_SHAKE = Shake(np.arange(8.5, 10.5, 0.2), np.arange(8.7, 10.7, 0.2), 0.0)


def _starts(phases, kind: PhaseKind) -> list[float]:
    return [phase.start_s for phase in phases if phase.kind is kind]


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_turned_on_the_way_is_not_tilted_back(device):
    """Who reads the counter lifts the device and turns its face up meanwhile; who inhales tilts it at the mouth."""
    inhaled, glance = (
        find_phases(_lifted((5.0, 0.25, after_s)), (), (), load_device(device)) for after_s in (1.4, 0.1)
    )
    assert _starts(inhaled, PhaseKind.INHALE) == pytest.approx([6.4], abs=0.1)
    assert not _starts(glance, PhaseKind.INHALE)


def test_a_device_is_inhaled_from_while_its_cover_is_open():
    """A second, higher visit with the cover shut is none, but the only one is told: the cover was shut too early."""
    strokes = [Event(EventKind.OPEN, 1.0, 1.5, 1.5, 95.0), Event(EventKind.CLOSE, 12.0, 12.5, 12.5, 95.0)]
    both = _lifted((3.0, 0.25, 1.4), (14.0, 0.35, 1.4), duration_s=24.0)
    shut = _lifted((14.0, 0.35, 1.4), duration_s=24.0)
    is_open = (both.time_s > 1.0) & (both.time_s < 12.0)
    for motion, inhaled_s in ((both, 4.4), (shut, 15.4)):
        phases = find_phases(with_lever(motion, is_open * np.radians(95.0)), (), strokes, load_device("ellipta"))
        assert _starts(phases, PhaseKind.INHALE) == pytest.approx([inhaled_s], abs=0.1)


@pytest.mark.parametrize(
    ("lift_m", "aside_deg", "is_visit"), [(0.3, 0.0, True), (0.3, 60.0, False), (0.13, 0.0, False)]
)
def test_what_comes_before_shaking_is_a_visit_if_it_looks_like_the_later_one(lift_m, aside_deg, is_visit):
    """A glance at the counter turns the device aside, or lifts it less."""
    motion = _lifted((2.0, lift_m, _NEVER_S), (13.0, 0.3, 1.4), duration_s=24.0)
    heading = np.where(motion.time_s < 8.0, np.radians(aside_deg), 0.0)
    phases = find_phases(replace(motion, heading_rad=heading), [_SHAKE], (), load_device("pmdi"))
    assert _starts(phases, PhaseKind.INHALE) == pytest.approx([14.4], abs=0.1)
    assert any(start_s < 8.0 for start_s in _starts(phases, PhaseKind.TO_MOUTH)) == is_visit


@pytest.mark.parametrize("presses", [[Event(EventKind.PRESS, 13.8, 14.0, 14.3, 15.0)], []])
def test_out_of_a_hold_near_the_mouth_a_press_shows_the_visit(presses):
    """Who never tilts and breathes out close to the mouth rises little; without a press that is no visit."""
    motion = _lifted((9.5, 0.25, _NEVER_S), (12.5, 0.11, _NEVER_S))
    phases = find_phases(motion, [_SHAKE], presses, load_device("pmdi"))
    assert any(start_s > 11.0 for start_s in _starts(phases, PhaseKind.TO_MOUTH)) == bool(presses)


def test_a_plain_hinge_has_no_phases():
    assert find_phases(still(20.0), (), (), load_device("hinge")) == ()


# --------------------------------------------------------------------------------------------------- simulated truth


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("device", DEVICES)
def test_the_inhalation_is_found_at_every_rate(device, rate_hz):
    """Start within 100 ms, end within 150 ms: a tilt-back begins and ends below what a hand's sway hides."""
    report, truth = scored(device, seed=62, rate_hz=rate_hz)
    found, acted = first(report, PhaseKind.INHALE), first(truth, PhaseKind.INHALE)
    assert found.start_s == pytest.approx(acted.start_s, abs=0.10)
    assert found.end_s == pytest.approx(acted.end_s, abs=0.15)


@pytest.mark.parametrize("device", DEVICES)
def test_most_of_every_step_is_found_with_clumsy_hands_and_poor_sensors(device):
    found, acted = scored(device, seed=63, profile="harsh")
    for kind in (PhaseKind.SHAKE, PhaseKind.OPEN, PhaseKind.INHALE, PhaseKind.BREATH_HOLD):
        true = first(acted, kind)
        if true is not None and true.end_s - true.start_s > 0.5:
            assert overlap(first(found, kind), true) > 0.6, kind


@pytest.mark.parametrize("device", DEVICES)
def test_a_session_that_stops_halfway_has_the_steps_it_shows(device):
    """Cut in the middle of the inhalation: it has begun, and nothing is said of what would follow."""
    recording, truth = im.simulate_session(device, seed=64)
    inhale = first(truth, PhaseKind.INHALE)
    report = im.score_recording(cut(recording, -1.0, (inhale.start_s + inhale.end_s) / 2))
    check_phases(report)
    assert first(report, PhaseKind.SHAKE if device == "pmdi" else PhaseKind.OPEN)
    assert first(report, PhaseKind.BREATH_HOLD) is None
    assert report.measures["breath_hold_s"].value is None


@pytest.mark.parametrize("device", DEVICES)
def test_a_session_that_starts_in_the_hand_has_its_inhalation(device):
    recording, truth = im.simulate_session(device, seed=65)
    step = first(truth, PhaseKind.SHAKE if device == "pmdi" else PhaseKind.OPEN)
    report = im.score_recording(cut(recording, step.start_s - 1.0, 1e9))
    check_phases(report)
    assert first(report, PhaseKind.INHALE).start_s == pytest.approx(first(truth, PhaseKind.INHALE).start_s, abs=0.15)


@pytest.mark.parametrize("device", DEVICES)
def test_a_device_is_at_rest_when_the_hand_has_let_go(device):
    """With the noisiest sensors at the highest rate; to 0.3 s, in which the table's bump dies away."""
    report, truth = scored(device, seed=68, profile="harsh", rate_hz=200.0)
    found, acted = report.phases[-1], truth.phases[-1]
    assert found.kind is acted.kind is PhaseKind.REST
    assert found.start_s == pytest.approx(acted.start_s, abs=0.3)


@pytest.mark.parametrize(("device", "attack"), list(product(DEVICES, ["walking", "car"])))
def test_the_inhalation_of_a_hand_that_is_never_still_is_found_by_its_turn(device, attack):
    """To half a second: what a step or a road adds must be smoothed away."""
    recording, truth = second_session(device, seed=69, attack=attack)
    found, acted = first(im.score_recording(recording), PhaseKind.INHALE), first(truth, PhaseKind.INHALE)
    assert found.start_s == pytest.approx(acted.start_s, abs=0.5)
    assert found.end_s == pytest.approx(acted.end_s, abs=0.5)


def test_a_gap_in_the_handling_leaves_the_steps_where_they_are():
    recording, truth = im.simulate_session("pmdi", seed=66)
    end_s = first(truth, PhaseKind.BREATH_HOLD).end_s + 1.0
    report = im.score_recording(without(recording, end_s, end_s + 0.4))
    check_phases(report)
    assert first(report, PhaseKind.INHALE).start_s == pytest.approx(first(truth, PhaseKind.INHALE).start_s, abs=0.10)
    assert any(flag.code == "gap" for flag in report.quality.flags)


def test_shaking_again_is_a_second_shake_of_the_same_dose():
    report, _ = scored("pmdi", ("order_wrong",), seed=67)
    check_phases(report)
    assert len(report.doses) == 1
    assert report.measures["order_violations"].value >= 1
