"""The whole way, on real recordings where they are at hand."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import inhalemon as im
from inhalemon.report import to_json
from inhalemon.values import PhaseKind, Verdict

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
