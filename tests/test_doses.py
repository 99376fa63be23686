"""Where one dose ends and the next begins."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import inhalemon as im
from inhalemon.devices import load_device
from inhalemon.stages.doses import split_doses
from inhalemon.values import Event, EventKind, ImuTrack, Phase, PhaseKind, Recording, Shake

PMDI, ELLIPTA, HINGE = (load_device(name) for name in ("pmdi", "ellipta", "hinge"))


def shake(start_s: float) -> Shake:
    strokes = start_s + 0.2 * np.arange(8)
    return Shake(strokes, strokes + 0.2, 0.4)


def opening(start_s: float) -> Event:
    return Event(EventKind.OPEN, start_s, start_s + 0.8, start_s + 0.8, 95.0)


def phases(*inhaled_s: float, end_s: float = 60.0) -> tuple[Phase, ...]:
    """Handling with an inhalation of 2 s at each time."""
    found, last_s = [], 0.0
    for start_s in inhaled_s:
        found += [Phase(PhaseKind.HANDLING, last_s, start_s), Phase(PhaseKind.INHALE, start_s, start_s + 2.0)]
        last_s = start_s + 2.0
    return (*found, Phase(PhaseKind.HANDLING, last_s, end_s))


@pytest.mark.parametrize(
    ("inhaled_s", "begins_s", "edges_s"),
    [
        ((10.0,), (3.0,), (0.0, 60.0)),
        ((10.0, 40.0), (3.0, 33.0), (0.0, 33.0, 60.0)),
        ((10.0, 25.0, 50.0), (3.0, 20.0, 45.0), (0.0, 20.0, 45.0, 60.0)),
        ((40.0,), (3.0, 33.0), (0.0, 60.0)),  # shaken again, not inhaled between: the same dose
        ((10.0, 40.0), (3.0, 30.0, 35.0), (0.0, 30.0, 60.0)),
        ((), (3.0,), (0.0, 60.0)),
        ((10.0, 40.0), (3.0,), (0.0, 60.0)),  # nothing prepared between the two: one dose
    ],
)
def test_a_dose_ends_when_the_next_is_prepared_after_an_inhalation(inhaled_s, begins_s, edges_s):
    expected = tuple(itertools.pairwise(edges_s))
    assert split_doses(phases(*inhaled_s), [shake(at) for at in begins_s], (), PMDI) == expected
    assert split_doses(phases(*inhaled_s), (), [opening(at) for at in begins_s], ELLIPTA) == expected


@pytest.mark.parametrize(("pressed_s", "edges_s"), [(11.0, (0.0, 33.0, 60.0)), (20.0, (0.0, 60.0)), (2.0, (0.0, 60.0))])
def test_a_press_at_the_mouth_stands_for_an_inhalation_that_does_not_show(pressed_s, edges_s):
    """Of who never tilts; not a press elsewhere, nor one before anything was shaken."""
    stays = tuple(Phase(PhaseKind.TO_MOUTH, at_s, at_s + 4.0) for at_s in (1.0, 9.0, 39.0))
    session = (*stays, Phase(PhaseKind.HANDLING, 43.0, 60.0))
    session = (Phase(PhaseKind.HANDLING, 0.0, 1.0), *session)
    press = Event(EventKind.PRESS, pressed_s, pressed_s + 0.2, pressed_s + 1.0, 15.0)
    assert split_doses(session, [shake(6.0), shake(33.0)], [press], PMDI) == tuple(itertools.pairwise(edges_s))


def test_a_cover_that_shuts_begins_no_dose():
    shut = Event(EventKind.CLOSE, 30.0, 31.0, 31.0, 0.0)
    assert split_doses(phases(10.0, 40.0), (), (opening(3.0), shut), ELLIPTA) == ((0.0, 60.0),)


def test_a_plain_hinge_and_a_session_without_phases_have_no_doses():
    assert split_doses(phases(10.0), (shake(3.0),), (), HINGE) == ()
    assert split_doses((), (), (), PMDI) == ()


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_two_simulated_doses_are_told_apart_and_timed(device):
    recording, truth = im.simulate_session(device, seed=51, n_doses=2)
    report = im.score_recording(recording)
    inhaled_s = [phase.start_s for phase in truth.phases if phase.kind is PhaseKind.INHALE]
    assert len(report.doses) == len(inhaled_s) == 2
    first, second = report.doses
    assert first.end_s == second.start_s
    assert inhaled_s[0] < first.end_s < inhaled_s[1]
    assert first.measures["puff_interval_s"].reason == "first_dose"
    # Each start within 0.1 s.
    assert second.measures["puff_interval_s"].value == pytest.approx(inhaled_s[1] - inhaled_s[0], abs=0.2)
    assert sum(len(dose.events) for dose in report.doses) == len(report.events)


@pytest.mark.parametrize("after_s", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("seed", [0, 3])
def test_recording_that_ends_while_the_cover_opens_again_is_scored(seed, after_s):
    """The last dose then has no phase of its own: the opening is all of it."""
    recording, truth = im.simulate_session("ellipta", seed=seed, n_doses=2)
    opened_s = [event.start_s for event in truth.events if event.kind is EventKind.OPEN]
    body, lever = (
        ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])
        for track in (recording.body, recording.lever)
        if (kept := track.time_s <= opened_s[1] + after_s).any()
    )
    report = im.score_recording(Recording("ellipta", body, lever))
    assert report.doses[-1].findings
