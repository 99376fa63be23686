"""The whole way, on real recordings where they are at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import inhalemon as im

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
