"""simulate, track and calibrate on real files, against the truth that the simulator wrote."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import os
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from inhalemon.cli import run
from inhalemon.devices import load_device
from inhalemon.recording import read_recording, write_recording
from inhalemon.simulate import simulate_session
from inhalemon.values import DeviceKind


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated")
    for device in ("pmdi", "ellipta"):
        code = run(["simulate", device, "--out", str(folder), "--profile", "perfect", "--doses", "2", "--seed", "4"])
        assert code == 0
    return folder


def test_simulated_files_are_those_of_the_library(simulated):
    recording, truth = simulate_session("pmdi", seed=4, profile="perfect", n_doses=2)
    read = read_recording(simulated / "pmdi-00004.csv")
    assert read.device is DeviceKind.PMDI
    np.testing.assert_allclose(read.body.gyr_rad_s, recording.body.gyr_rad_s, atol=1e-6)  # the file's six decimals
    labels = json.loads((simulated / "pmdi-00004.truth.json").read_text())
    assert labels["mistakes"] == []
    assert len(labels["phases"]) == len(truth.phases)


def test_mistakes_are_acted_as_asked_and_drawn_alike_for_the_same_seed(tmp_path, capsys):
    asked = ["simulate", "pmdi", "--out", str(tmp_path), "--mistake", "press_late", "--format", "csv.gz"]
    assert run(asked) == 0
    assert json.loads((tmp_path / "pmdi-00000.truth.json").read_text())["mistakes"] == ["press_late"]
    drawn = ["simulate", "ellipta", "--out", str(tmp_path), "--random-mistakes", "--count", "2", "--rate", "50"]
    capsys.readouterr()
    assert run(drawn) == 0
    first = capsys.readouterr().out
    assert run(drawn) == 0
    assert capsys.readouterr().out == first
    assert first.count("\n") == 2


def test_every_row_of_a_track_has_a_time_of_its_own_though_the_clock_counts_from_1970(simulated, tmp_path, capsys):
    recording = read_recording(simulated / "pmdi-00004.csv")
    late = {
        name: dataclasses.replace(track, time_s=track.time_s + 1.76e9)
        for name, track in (("body", recording.body), ("lever", recording.lever))
    }
    write_recording(dataclasses.replace(recording, **late), tmp_path / "late.csv")
    assert run(["track", str(tmp_path / "late.csv")]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    times = [float(row.split(",")[header.split(",").index("time_s")]) for row in rows]
    np.testing.assert_allclose(times, recording.body.time_s + 1.76e9, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "arguments",
    [["--mistake", "nonsense"], ["--mistake", "press_late", "--random-mistakes"], ["--rate", "5"], ["--count", "0"]],
)
def test_what_cannot_be_simulated_is_wrong_usage(tmp_path, arguments):
    assert run(["simulate", "pmdi", "--out", str(tmp_path), *arguments]) == 2


def test_track_gives_the_true_lever_angle_and_tilt_in_degrees(simulated, tmp_path):
    """Exact sensors: what is left is the filter's settling and the file's rounding."""
    out = tmp_path / "track.parquet"
    assert run(["track", str(simulated / "ellipta-00004.csv"), "--out", str(out)]) == 0
    _, truth = simulate_session("ellipta", seed=4, profile="perfect", n_doses=2)
    found = {name: column.to_numpy() for name, column in zip(*columns_of(out), strict=True)}
    assert np.sqrt(np.mean((found["lever_angle_deg"] - np.rad2deg(truth.angle_rad)) ** 2)) < 1.5
    assert np.sqrt(np.mean((found["tilt_body_deg"] - np.rad2deg(truth.tilt_rad)) ** 2)) < 1.0
    assert (found["lever_angle_sd_deg"] > 0.0).all()
    q = np.column_stack([found[f"q_ref_body_{axis}"] for axis in "wxyz"])
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)


def columns_of(path):
    table = pq.read_table(path)
    return table.column_names, table.columns


def test_track_writes_the_same_numbers_as_csv_and_from_standard_input(simulated, tmp_path, capsys):
    path = simulated / "pmdi-00004.csv"
    assert run(["track", str(path)]) == 0
    text = capsys.readouterr().out
    told = subprocess.run(
        [sys.executable, "-m", "inhalemon", "track", "-", "--device", "pmdi"],
        input=path.read_bytes(),
        capture_output=True,
        check=True,
        env={**os.environ},
    )
    assert run(["track", str(path), "--out", str(tmp_path / "t.parquet")]) == 0
    names, columns = columns_of(tmp_path / "t.parquet")
    assert text.splitlines()[0] == ",".join(names)
    rows = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows, np.column_stack(columns), rtol=1e-8)
    # Without the sidecar no range is known; the angle is the same all but where a sample was at its range.
    piped = np.loadtxt(io.BytesIO(told.stdout), delimiter=",", skiprows=1)
    at = names.index("lever_angle_deg")
    assert np.abs(piped[:, at] - rows[:, at]).max() < 0.5


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_calibrate_learns_the_true_travel_as_well_as_it_says(simulated, tmp_path, device, capsys):
    out = tmp_path / "mine.toml"
    assert run(["calibrate", str(simulated / f"{device}-00004.csv"), "--out", str(out)]) == 0
    _, truth = simulate_session(device, seed=4, profile="perfect", n_doses=2)
    learned = load_device(out)
    assert learned.is_calibrated
    sd_deg = float(capsys.readouterr().err.split("(sd ")[1].split(")")[0])
    assert abs(math.degrees(learned.full_travel_rad - truth.travel_rad)) < 3 * max(sd_deg, 0.5)
    assert load_device(device).hinge_axis == pytest.approx(learned.hinge_axis, abs=math.sin(math.radians(15)))


def test_a_parquet_file_of_something_else_is_no_recording(simulated, tmp_path, capsys):
    out = tmp_path / "track.parquet"
    assert run(["track", str(simulated / "pmdi-00004.csv"), "--out", str(out)]) == 0
    assert run(["track", str(out), "--device", "pmdi"]) == 3
    assert "unknown column" in capsys.readouterr().err


def test_a_recording_without_a_stroke_cannot_calibrate(tmp_path, capsys):
    assert run(["simulate", "pmdi", "--out", str(tmp_path), "--mistake", "no_press"]) == 0
    assert run(["calibrate", str(tmp_path / "pmdi-00000.csv")]) == 3
    assert "full strokes beyond 5 deg" in capsys.readouterr().err


def test_a_learned_profile_serves_as_device(simulated, tmp_path):
    out = tmp_path / "mine.toml"
    assert run(["calibrate", str(simulated / "pmdi-00004.csv"), "--out", str(out)]) == 0
    assert run(["track", str(simulated / "pmdi-00004.csv"), "--device", str(out)]) == 0
    out.write_text(out.read_text().replace("hinge_sign = 1", "hinge_sign = 7"))
    assert run(["track", str(simulated / "pmdi-00004.csv"), "--device", str(out)]) == 4


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["track", "nowhere.csv"], 3),
        (["track", "."], 3),
        (["track", "nowhere.csv", "--device", "nonsense"], 2),
        (["track", "nowhere.csv", "--out", "x.txt"], 2),
        (["track", "nowhere.csv", "--settings", "nowhere.toml"], 4),
    ],
)
def test_each_kind_of_failure_has_its_exit_code(arguments, code, capsys):
    assert run(arguments) == code
    assert "Traceback" not in capsys.readouterr().err
