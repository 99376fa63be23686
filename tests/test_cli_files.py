"""check, report and convert on real files."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from inhalemon.cli import run
from inhalemon.recording import read_recording, write_recording
from inhalemon.simulate import simulate_session


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A good session and half a file."""
    folder = tmp_path_factory.mktemp("two")
    recording, truth = simulate_session("ellipta", seed=8, session_id="good")
    write_recording(recording, folder / "good.csv.gz")
    truth.write_labels(folder / "good.csv.gz")
    packed = (folder / "good.csv.gz").read_bytes()
    (folder / "half.csv.gz").write_bytes(packed[: len(packed) // 2])
    (folder / "half.json").write_bytes((folder / "good.json").read_bytes())
    return folder


def test_check_tells_what_can_be_used_and_what_cannot(two, capsys):
    assert run(["check", str(two), "--format", "json"]) == 3
    told = capsys.readouterr()
    good, half = json.loads(told.out)
    assert (good["device"], good["usable"]) == ("ellipta", True)
    assert good["body_rate_hz"] == pytest.approx(100.0, rel=0.02)
    assert half["format"] == "inhalemon-error/1"
    assert told.err.count("\n") == 1


def test_check_prints_a_row_a_file(two, capsys):
    assert run(["check", str(two)]) == 3
    said = capsys.readouterr().out
    assert "good.csv.gz" in said
    assert "refused" in said


def test_report_is_one_page_that_loads_nothing_from_elsewhere(two, tmp_path):
    out = tmp_path / "session.html"
    assert run(["report", str(two / "good.csv.gz"), "--out", str(out)]) == 0
    page = out.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert "good" in page
    assert "http://" not in page.replace("http://www.w3.org/", "")
    assert "https://" not in page


def test_report_of_what_cannot_be_used_leaves_no_file(two, tmp_path):
    out = tmp_path / "session.html"
    assert run(["report", str(two / "half.csv.gz"), "--out", str(out)]) == 3
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", ["csv", "csv.zst", "parquet"])
def test_a_converted_recording_is_the_same_recording(two, tmp_path, form):
    assert run(["convert", str(two / "good.csv.gz"), "--to", form, "--out", str(tmp_path)]) == 0
    before, after = read_recording(two / "good.csv.gz"), read_recording(tmp_path / f"good.{form}")
    assert (after.session_id, after.device, after.sensors) == (before.session_id, before.device, before.sensors)
    np.testing.assert_allclose(after.lever.acc_m_s2, before.lever.acc_m_s2, atol=1e-6)
    np.testing.assert_allclose(after.lever.time_s, before.lever.time_s, atol=1e-6)


def test_a_motion_bids_session_holds_the_same_numbers(two, tmp_path):
    assert run(["convert", str(two / "good.csv.gz"), "--to", "motion-bids", "--out", str(tmp_path)]) == 0
    recording = read_recording(two / "good.csv.gz")
    subject = f"sub-{recording.patient_ref.replace('-', '')}"
    stem = f"{subject}_ses-good_task-inhalation_tracksys-lever"
    motion = tmp_path / subject / "ses-good" / "motion"
    rows = np.loadtxt(motion / f"{stem}_motion.tsv", delimiter="\t")
    lever = recording.lever
    latency_s = lever.time_s - min(recording.body.time_s[0], lever.time_s[0])
    np.testing.assert_allclose(rows[:, 0], latency_s, atol=1e-6)
    np.testing.assert_allclose(rows[:, 1:], np.column_stack([lever.acc_m_s2, lever.gyr_rad_s]), rtol=1e-8)
    names = [line.split("\t")[0] for line in (motion / f"{stem}_channels.tsv").read_text().splitlines()]
    assert names == ["name", "latency", "acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"]
    about = json.loads((motion / f"{stem}_motion.json").read_bytes())
    assert about["SamplingFrequency"] == pytest.approx(lever.rate_hz)
    assert (tmp_path / "participants.tsv").read_text() == f"participant_id\n{subject}\n"


def test_motion_bids_latencies_are_seconds_from_the_start_whatever_the_clock(two, tmp_path):
    """The specification wants ss[.000000]: neither the clock's epoch nor a power of ten."""
    recording = read_recording(two / "good.csv.gz")
    late = {
        name: dataclasses.replace(track, time_s=track.time_s + 1.76e9)
        for name, track in (("body", recording.body), ("lever", recording.lever))
    }
    write_recording(dataclasses.replace(recording, **late), tmp_path / "late.csv")
    assert run(["convert", str(tmp_path / "late.csv"), "--to", "motion-bids", "--out", str(tmp_path / "bids")]) == 0
    starts = []
    for motion in (tmp_path / "bids").rglob("*_motion.tsv"):
        latencies = [line.split("\t")[0] for line in motion.read_text().splitlines()]
        assert all(re.fullmatch(r"\d+\.\d{6}", each) for each in latencies)
        assert len(set(latencies)) == len(latencies)
        starts.append(float(latencies[0]))
    assert min(starts) == 0.0
    assert max(starts) < 0.1


def test_a_motion_bids_session_is_never_overwritten(two, tmp_path, capsys):
    command = ["convert", str(two / "good.csv.gz"), "--to", "motion-bids", "--out", str(tmp_path)]
    assert run(command) == 0
    assert run(command) == 3
    assert "already there" in capsys.readouterr().err


@pytest.mark.parametrize("identity", ["../../away", "/tmp/away", "a/b", "visit 1"])
def test_a_converted_file_is_named_by_its_file_and_stays_in_the_folder(two, tmp_path, identity, capsys):
    """What stands in a sidecar came from somebody else: it never says where files go."""
    source, out = tmp_path / "in" / "s.csv", tmp_path / "deep" / "out"
    source.parent.mkdir()
    write_recording(read_recording(two / "good.csv.gz"), source)
    about = json.loads(source.with_suffix(".json").read_bytes())
    source.with_suffix(".json").write_text(json.dumps(about | {"session_id": identity}))
    before = {*tmp_path.rglob("*"), *Path("/tmp").glob("away*")}
    assert run(["convert", str(source), "--to", "csv", "--out", str(out)]) == 0
    made = {*tmp_path.rglob("*"), *Path("/tmp").glob("away*")} - before
    assert made == {out.parent, out, out / "s.csv", out / "s.json"}
    assert read_recording(out / "s.csv").session_id == identity


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_two_recordings_of_one_name_do_not_overwrite_one_another(two, tmp_path, form, capsys):
    recording = read_recording(two / "good.csv.gz")
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        write_recording(dataclasses.replace(recording, session_id=folder), tmp_path / folder / "s.csv")
    out = tmp_path / "out"
    assert run(["convert", str(tmp_path / "x"), str(tmp_path / "y"), "--to", form, "--out", str(out)]) == 3
    told = capsys.readouterr()
    assert told.out == f"{out / f's.{form}'}\n"
    assert "already there" in told.err
    assert read_recording(out / f"s.{form}").session_id == "x"


def test_converting_goes_on_after_a_bad_file(two, tmp_path, capsys):
    assert run(["convert", str(two), "--to", "csv", "--out", str(tmp_path)]) == 3
    told = capsys.readouterr()
    assert told.out == f"{tmp_path / 'good.csv'}\n"
    assert "half.csv.gz" in told.err
