"""What is written is read back, in every form of the recording file."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

import inhalemon as im
from inhalemon.values import DeviceKind, ImuTrack, Recording, SensorInfo, SensorName

FORMS = ("csv", "csv.gz", "csv.zst", "parquet")


def _track(rng: np.random.Generator, *, n: int = 300, offset_s: float = 0.0, **ranges: float) -> ImuTrack:
    time_s = np.round(offset_s + np.arange(n) / 100, 6)
    return ImuTrack(time_s, np.round(rng.normal(0, 9, (n, 3)), 6), np.round(rng.normal(0, 3, (n, 3)), 6), **ranges)


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(7)
    return Recording(
        device=DeviceKind.PMDI,
        body=_track(rng, acc_range_m_s2=16 * 9.80665, gyr_range_rad_s=np.radians(2000.0)),
        lever=_track(rng, n=290, offset_s=-0.0031),
        session_id="a session",
        recorded_at="2026-11-20T08:30:00+09:00",
        patient_ref="p-17",
        sensors={SensorName.BODY: SensorInfo(model="LSM9DS1")},
    )


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_back_the_same_recording(recording: Recording, tmp_path: Path, form: str) -> None:
    path = tmp_path / f"one.two.{form}"
    im.write_recording(recording, path)
    again = im.read_recording(path)
    for name in SensorName:
        before, after = getattr(recording, name), getattr(again, name)
        np.testing.assert_array_equal(after.time_s, before.time_s)
        np.testing.assert_array_equal(after.acc_m_s2, before.acc_m_s2)
        np.testing.assert_array_equal(after.gyr_rad_s, before.gyr_rad_s)
    for field in ("device", "session_id", "recorded_at", "patient_ref"):
        assert getattr(again, field) == getattr(recording, field)
    assert dict(again.sensors) == dict(recording.sensors)
    assert again.body.acc_range_m_s2 == pytest.approx(16 * 9.80665)
    assert again.lever.acc_range_m_s2 is None


@pytest.mark.parametrize("form", FORMS)
def test_bytes_and_streams_are_read_like_files(recording: Recording, tmp_path: Path, form: str) -> None:
    path = tmp_path / f"one.{form}"
    im.write_recording(recording, path)
    data = path.read_bytes()
    for source in (data, io.BytesIO(data)):
        again = im.read_recording_bytes(source, name="-", device="ellipta")
        assert again.device == "ellipta"
        np.testing.assert_array_equal(again.lever.acc_m_s2, recording.lever.acc_m_s2)


def test_without_a_sidecar_the_stem_names_the_session(recording: Recording, tmp_path: Path) -> None:
    im.write_recording(recording, tmp_path / "morning.v2.csv.gz")
    (tmp_path / "morning.v2.json").unlink()
    assert im.read_recording(tmp_path / "morning.v2.csv.gz", device="hinge").session_id == "morning.v2"


def test_a_given_device_overrides_the_sidecar(recording: Recording, tmp_path: Path) -> None:
    im.write_recording(recording, tmp_path / "a.csv")
    assert json.loads((tmp_path / "a.json").read_text())["device"] == "pmdi"
    assert im.read_recording(tmp_path / "a.csv", device="hinge").device == "hinge"
