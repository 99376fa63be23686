"""The sample sessions are what `sample_data/make.py` makes, and say what was acted."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

import inhalemon as im

FOLDER = Path(__file__).resolve().parents[1] / "sample_data"
MAKE = runpy.run_path(str(FOLDER / "make.py"))
SESSIONS = [sample.file for sample in MAKE["SAMPLES"]]


@pytest.fixture(scope="module")
def remade(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    MAKE["make"](folder)
    return folder


@pytest.mark.parametrize("file", SESSIONS)
def test_sample_is_made_again_by_its_script(file, remade):
    """The numbers agree to the least digit written (compressed bytes may differ between versions of the packers)."""
    kept, made = im.read_recording(FOLDER / file), im.read_recording(remade / file)
    assert kept.session_id == made.session_id
    assert kept.device is made.device
    for part in ("body", "lever"):
        for column in ("time_s", "acc_m_s2", "gyr_rad_s"):
            np.testing.assert_allclose(
                getattr(getattr(kept, part), column), getattr(getattr(made, part), column), atol=1.01e-6, rtol=0
            )
    stem = file.split(".")[0]
    assert json.loads((FOLDER / f"{stem}.truth.json").read_text()) == json.loads(
        (remade / f"{stem}.truth.json").read_text()
    )


def test_expected_grades_follow_from_the_labels(remade):
    expected = json.loads((FOLDER / "expected.json").read_text())
    assert expected == json.loads((remade / "expected.json").read_text())
    assert sorted(expected) == sorted(file.split(".")[0] for file in SESSIONS)
    for session_id, wanted in expected.items():
        labels = json.loads((FOLDER / f"{session_id}.truth.json").read_text())
        assert labels["mistakes"] == wanted["mistakes"]
        assert (wanted["grade"] == "correct") == (not wanted["mistakes"])


def test_reading_a_written_session_gives_it_back(tmp_path):
    """A simulated session survives the file to the digits written: a microsecond, a millionth of a unit."""
    recording, _ = im.simulate_session("pmdi", seed=3, profile="harsh")
    im.write_recording(recording, tmp_path / "one.csv.gz")
    back = im.read_recording(tmp_path / "one.csv.gz")
    assert back.device is recording.device
    for part in ("body", "lever"):
        for column in ("time_s", "acc_m_s2", "gyr_rad_s"):
            np.testing.assert_allclose(
                getattr(getattr(back, part), column), getattr(getattr(recording, part), column), atol=0.51e-6, rtol=0
            )


def test_samples_stay_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir() if path.is_file()) < 6e6
