"""Recordings made in Python keep to the same limits as those that are read."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import inhalemon as im
from inhalemon.exceptions import RecordingError
from inhalemon.values import ImuTrack, Recording


def track(n: int = 300, *, rate_hz: float = 100.0, **more: object) -> ImuTrack:
    return ImuTrack(np.arange(n) / rate_hz, np.tile([0.0, 0.0, 9.81], (n, 1)), np.zeros((n, 3)), **more)  # type: ignore[arg-type]


GOOD = Recording("pmdi", track(), track())  # type: ignore[arg-type]  # text is taken for a device too


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"body": None}, "sensor_missing"),
        ({"lever": np.zeros((300, 7))}, "sensor_missing"),
        ({"body": track(0)}, "too_short"),
        ({"body": track(1)}, "too_short"),
        ({"body": track(2)}, "too_short"),
        ({"lever": track(190)}, "too_short"),
        ({"lever": track(100, rate_hz=24.0)}, "rate_out_of_range"),
        ({"body": track(6000, rate_hz=1e6)}, "rate_out_of_range"),
        ({"body": track(100_000, rate_hz=27.0)}, "too_long"),
        ({"device": "spacer"}, "unknown_device"),
        ({"session_id": ""}, "unfit_text"),
        ({"session_id": "one\ntwo"}, "unfit_text"),
        ({"session_id": 7}, "unfit_text"),
        ({"patient_ref": "x" * 201}, "unfit_text"),
        ({"recorded_at": "2026-11-20"}, "unfit_text"),
    ],
)
def test_what_no_file_may_hold_cannot_be_made_either(changes: dict[str, object], code: str) -> None:
    with pytest.raises(RecordingError, match="expected") as refused:
        dataclasses.replace(GOOD, **changes)  # type: ignore[arg-type]  # wrong on purpose
    assert refused.value.code == code


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"acc_m_s2": [[0.0, 0.0, 9.81], [0.0, 0.0]]}, "wrong_shape"),
        ({"acc_m_s2": None}, "wrong_shape"),
        ({"acc_m_s2": [["a", "b", "c"]] * 2}, "wrong_shape"),
        ({"time_s": [[0.0, 0.01]]}, "wrong_shape"),
        ({"mag_ut": np.zeros((3, 3))}, "wrong_shape"),
        ({"is_acc_saturated": np.zeros(3, dtype=bool)}, "wrong_shape"),
        ({"is_gyr_saturated": np.zeros((2, 3), dtype=bool)}, "wrong_shape"),
        ({"gyr_rad_s": np.full((2, 3), np.nan)}, "not_finite"),
        ({"time_s": [0.0, 0.0]}, "time_not_increasing"),
        ({"acc_range_m_s2": -16.0}, "out_of_range"),
        ({"gyr_range_rad_s": np.nan}, "out_of_range"),
    ],
)
def test_a_track_that_does_not_fit_together_is_refused(wrong: dict[str, object], code: str) -> None:
    whole = {"time_s": [0.0, 0.01], "acc_m_s2": np.zeros((2, 3)), "gyr_rad_s": np.zeros((2, 3))}
    with pytest.raises(RecordingError) as refused:
        ImuTrack(**whole | wrong)  # type: ignore[arg-type]  # wrong on purpose
    assert refused.value.code == code


def test_a_file_that_breaks_a_limit_is_named(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    im.write_recording(GOOD, path)
    path.write_bytes(b"\n".join(path.read_bytes().splitlines()[:-150]))
    with pytest.raises(RecordingError, match=r"short\.csv: time_s is 1.5 s of lever; expected at least 2 s"):
        im.read_recording(path)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_the_ranges_of_a_track_are_written_and_read(tmp_path: Path, form: str) -> None:
    """They stand in the track alone, so nothing else must be filled in for them to last."""
    ranged = track(acc_range_m_s2=16 * 9.80665, gyr_range_rad_s=np.radians(2000.0))
    im.write_recording(dataclasses.replace(GOOD, body=ranged), tmp_path / f"x.{form}")
    again = im.read_recording(tmp_path / f"x.{form}")
    assert again.body.acc_range_m_s2 == pytest.approx(16 * 9.80665)
    assert again.body.gyr_range_rad_s == pytest.approx(np.radians(2000.0))
    assert again.lever.acc_range_m_s2 is None
    if form == "csv":
        assert '"acc_range_g": 16.0' in (tmp_path / "x.json").read_text()


@pytest.mark.parametrize("name", ["two\nlines", "x" * 240])
def test_a_file_of_any_name_gives_a_session_id(tmp_path: Path, name: str) -> None:
    im.write_recording(GOOD, tmp_path / "x.csv")
    read = im.read_recording((tmp_path / "x.csv").rename(tmp_path / f"{name}.csv"), device="pmdi")
    assert read.session_id.isprintable()
    assert 0 < len(read.session_id) <= 200


def test_a_lever_whose_clock_runs_late_is_no_shorter_recording() -> None:
    """Limits are asked of what was recorded: an hour on one clock may be longer than an hour on the other."""
    lever = dataclasses.replace(GOOD.lever, time_s=GOOD.lever.time_s / 2.0)
    assert GOOD.with_tracks(lever=lever).lever is lever
