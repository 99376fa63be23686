"""The whole way, on real recordings where they are at hand."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import inhalemon as im
from inhalemon.report import to_json
from inhalemon.values import FloatArray, PhaseKind, Verdict

HINGE = Path(__file__).parents[2] / "shared" / "data" / "hinge"


@pytest.mark.parametrize("name", ["trial1_2-3_x", "trial1_3-4_y", "trial1_4-5_z"])
def test_hinge_of_a_real_recording_is_followed_within_two_degrees(name):
    path = HINGE / f"{name}.npz"
    if not path.exists():
        pytest.skip("../shared/data/hinge is absent: real recordings with optical truth are not part of the project")
    data = np.load(path)
    time_s = np.arange(data["angle_rad"].size) / 40.0
    recording = im.Recording(
        device="hinge",
        body=im.ImuTrack(time_s, data["body_acc"], data["body_gyr"]),
        lever=im.ImuTrack(time_s, data["lever_acc"], data["lever_gyr"]),
    )
    found = im.track_lever(recording)
    first = (time_s < 30.0) & data["valid"]
    error_deg = np.degrees(np.remainder(found.angle_rad - data["angle_rad"] + np.pi, 2 * np.pi) - np.pi)[first]
    assert np.sqrt(np.mean(error_deg**2)) < 2.0


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_simulated_session_without_mistakes_has_its_steps_in_order(device):
    recording, truth = im.simulate_session(device, seed=11)
    report = im.score_recording(recording)
    kinds = [phase.kind for phase in report.phases]
    steps = [PhaseKind.SHAKE if device == "pmdi" else PhaseKind.OPEN, PhaseKind.INHALE, PhaseKind.BREATH_HOLD]
    assert [kind for kind in kinds if kind in steps] == steps
    inhale = next(phase for phase in report.phases if phase.kind is PhaseKind.INHALE)
    assert abs(inhale.start_s - truth.measures["inhalation_start_s"]) < 0.1
    assert report.phases[0].start_s <= recording.body.time_s[0] + 0.01
    assert report.phases[-1].end_s >= recording.body.time_s[-1] - 0.01
    for before, after in itertools.pairwise(report.phases):
        assert before.end_s == after.start_s


@pytest.mark.parametrize(
    ("device", "mistake"),
    [("pmdi", "not_shaken"), ("pmdi", "press_late"), ("ellipta", "cover_not_fully_open"), ("ellipta", "no_inhalation")],
)
def test_simulated_mistake_is_found(device, mistake):
    recording, _ = im.simulate_session(device, mistakes=(mistake,), seed=4)
    findings = {finding.rule: finding.verdict for finding in im.score_recording(recording).findings}
    assert findings[mistake] is Verdict.FAIL


def test_same_recording_gives_the_same_report():
    recording, _ = im.simulate_session("pmdi", seed=2)
    assert to_json(im.score_recording(recording)) == to_json(im.score_recording(recording))


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_what_was_known_under_way_stands_when_the_recording_goes_on(seed: int) -> None:
    """Only the clocks are compared over the whole recording: a millisecond of lag, 2 deg in the quickest shake."""
    recording, _ = im.simulate_session("pmdi", seed=seed, profile="harsh")

    def angle_rad(end_s: float) -> FloatArray:
        parts = []
        for track in (recording.body, recording.lever):
            kept = track.time_s - track.time_s[0] < end_s
            parts.append(im.ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept]))
        begun = im.Recording(device=recording.device, body=parts[0], lever=parts[1])
        return im.track_lever(begun, im.Settings.causal()).angle_rad

    whole = angle_rad(1e3)
    for end_s in (9.0, 15.0):
        known = angle_rad(end_s)[:-50]  # the end of the shorter one: the lever's own samples end there
        assert np.degrees(np.abs(known - whole[: known.size])).max() < 3.0
