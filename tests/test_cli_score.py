"""score on real files: formats, failures, batches, resumption."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import sys
import time

import pytest
from clock import least_processor_s

from inhalemon.cli import run
from inhalemon.recording import write_recording
from inhalemon.report.flat import csv_columns
from inhalemon.simulate import simulate_session

SEEDS = (0, 1, 2)


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """Three good sessions and, sorted into their middle, one that cannot be used."""
    folder = tmp_path_factory.mktemp("three")
    for seed in SEEDS:
        recording, truth = simulate_session("pmdi" if seed else "ellipta", seed=seed)
        path = folder / f"s{seed}.csv"
        write_recording(recording, path)
        truth.write_labels(path)
    bad = (folder / "s1.csv").read_text().splitlines()
    bad[811] = bad[811].replace(bad[811].split(",")[2], "nan")
    (folder / "s1_bad.csv").write_text("\n".join(bad) + "\n")
    (folder / "s1_bad.json").write_bytes((folder / "s1.json").read_bytes())
    return folder


@pytest.fixture
def good(three, tmp_path):
    """The three good sessions alone, in a folder of this test's own."""
    for seed in SEEDS:
        for suffix in (".csv", ".json"):
            (tmp_path / f"s{seed}{suffix}").write_bytes((three / f"s{seed}{suffix}").read_bytes())
    return tmp_path


def inhalemon(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "inhalemon", *map(str, arguments)], capture_output=True, check=False, **options
    )


def documents(text):
    return [json.loads(line) for line in text.splitlines()]


def ids(found):
    return [document.get("session_id") or os.path.basename(document["file"]) for document in found]


IN_ORDER = ["ellipta-00000", "pmdi-00001", "s1_bad.csv", "pmdi-00002"]


def test_a_bad_file_stops_no_other_and_stands_in_its_place(three, capsys):
    assert run(["score", str(three), "--format", "jsonl"]) == 3
    told = capsys.readouterr()
    found = documents(told.out)
    assert ids(found) == IN_ORDER
    assert found[2]["format"] == "inhalemon-error/1"
    assert found[2]["error"]["line"] == 812
    assert found[2]["error"]["column"].startswith("acc_x")
    assert told.err.count("\n") == 1
    assert "s1_bad.csv line 812" in told.err


def test_good_recordings_end_with_0_whatever_their_score(good, capsys):
    assert run(["score", str(good), "--format", "jsonl"]) == 0
    assert [document["format"] for document in documents(capsys.readouterr().out)] == ["inhalemon-report/1"] * 3


def test_json_is_one_report_for_a_file_and_a_list_for_a_folder(three, capsys):
    assert run(["score", str(three / "s2.csv"), "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["session_id"] == "pmdi-00002"
    assert run(["score", str(three), "--format", "json"]) == 3
    assert ids(json.loads(capsys.readouterr().out)) == IN_ORDER


def test_csv_has_one_row_a_session_and_one_header(three, capsys):
    assert run(["score", str(three), "--format", "csv"]) == 3
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert tuple(rows[0]) == csv_columns()
    assert len(rows) == 4
    assert rows[2]["error_code"]


def test_table_names_every_session_and_says_which_cannot_be_used(three, capsys):
    assert run(["score", str(three)]) == 3
    said = capsys.readouterr().out
    assert all(name in said for name in IN_ORDER)
    assert "not usable" in said


def test_a_missing_file_does_not_stop_the_others(three, capsys):
    assert run(["score", str(three / "nowhere.csv"), str(three / "s0.csv"), "--format", "jsonl"]) == 3
    told = capsys.readouterr()
    assert ids(documents(told.out)) == ["nowhere.csv", "ellipta-00000"]
    assert "nowhere.csv" in told.err


def test_standard_input_is_a_recording(three):
    told = inhalemon("score", "-", "--device", "pmdi", "--format", "json", input=(three / "s1.csv").read_bytes())
    assert told.returncode == 0, told.stderr
    assert json.loads(told.stdout)["device"] == "pmdi"


def test_device_overrides_the_sidecar_and_is_needed_without_one(three, tmp_path, capsys):
    alone = tmp_path / "alone.csv"
    alone.write_bytes((three / "s1.csv").read_bytes())
    assert run(["score", str(alone)]) == 3
    assert "--device" in capsys.readouterr().err
    assert run(["score", str(three / "s1.csv"), "--device", "hinge", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["device"] == "hinge"


@pytest.mark.parametrize(
    ("option", "text", "code"),
    [
        ("--settings", "[attitude]\nmethod = 'magic'\n", 4),
        ("--settings", "no toml", 4),
        ("--rules", "[rules.press_late]\nwhen = 'late'\n", 4),
        ("--device", "title = 'half a profile'\n", 4),
    ],
)
def test_bad_settings_rules_and_profiles_end_with_4_and_score_nothing(three, tmp_path, option, text, code, capsys):
    file = tmp_path / "file.toml"
    file.write_text(text)
    assert run(["score", str(three), option, str(file)]) == code
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert "file.toml" in told.err


@pytest.mark.parametrize("arguments", [["--jobs", "0"], ["--format", "xml"], ["--device", "nonsense"]])
def test_wrong_usage_ends_with_2(three, arguments):
    assert run(["score", str(three), *arguments]) == 2


def test_processes_and_one_alone_write_the_same_bytes_in_the_same_order(three):
    alone = inhalemon("score", three, "--format", "jsonl", "--jobs", "1")
    shared = inhalemon("score", three, "--format", "jsonl", "--jobs", "2")
    assert alone.returncode == shared.returncode == 3
    assert alone.stdout == shared.stdout
    assert alone.stderr == shared.stderr


@pytest.mark.parametrize("form", ["jsonl", "csv", "json"])
def test_a_second_run_adds_only_what_is_missing(three, good, form):
    out = good / f"out.{form}"
    assert run(["score", str(good / "s0.csv"), "--format", form, "--out", str(out)]) == 0
    first = out.read_bytes()
    everything = [str(good / name) for name in ("s0.csv", "s1.csv", "s2.csv")]
    assert run(["score", *everything, "--out", str(out)]) == 0
    second = out.read_bytes()
    assert run(["score", *everything, "--out", str(out)]) == 0
    assert out.read_bytes() == second
    if form == "json":
        assert ids(json.loads(second)) == ["ellipta-00000", "pmdi-00001", "pmdi-00002"]
    else:
        assert second.startswith(first)
        assert second.count(b"\n") == 3 + (form == "csv")


@pytest.mark.parametrize("form", ["jsonl", "csv", "json"])
def test_an_unusable_recording_is_tried_again_and_told_once(three, tmp_path, form, capsys):
    out = tmp_path / f"out.{form}"
    assert run(["score", str(three), "--out", str(out)]) == 3
    before = out.read_bytes()
    assert run(["score", str(three), "--out", str(out)]) == 3
    assert capsys.readouterr().err.count("s1_bad.csv line 812") == 2
    if form == "json":
        in_order = [json.loads(before)[index] for index in (0, 1, 3, 2)]
        assert json.loads(out.read_bytes()) == in_order
    else:
        assert sorted(out.read_bytes().splitlines()) == sorted(before.splitlines())


@pytest.mark.parametrize("form", ["jsonl", "csv", "json"])
def test_a_recording_that_was_mended_loses_its_error(three, good, form):
    out = good.with_suffix(f".{form}")
    whole = (good / "s1.csv").read_bytes()
    (good / "s1.csv").write_bytes((three / "s1_bad.csv").read_bytes())
    assert run(["score", str(good), "--out", str(out)]) == 3
    (good / "s1.csv").write_bytes(whole)
    assert run(["score", str(good), "--out", str(out)]) == 0
    assert b"812" not in out.read_bytes()
    assert b"not_a_number" not in out.read_bytes()
    assert out.read_bytes().count(b"pmdi-00001") == 1


@pytest.mark.parametrize("name", ["out.json", "out.jsonl", "out.txt"])
def test_a_file_that_cannot_be_written_is_told_before_anything_is_scored(three, tmp_path, name, capsys):
    out = tmp_path / "no such folder" / name
    assert run(["score", str(three), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert told == f"inhalemon: {out}: No such file or directory\n"
    (tmp_path / name).mkdir()
    assert run(["score", str(three), "--out", str(tmp_path / name)]) == 2
    assert capsys.readouterr().err == f"inhalemon: {tmp_path / name}: Is a directory\n"


@pytest.mark.parametrize("form", ["jsonl", "csv"])
def test_half_a_line_left_by_a_kill_is_scored_again(three, tmp_path, form):
    whole, out = tmp_path / f"whole.{form}", tmp_path / f"out.{form}"
    run(["score", str(three), "--out", str(whole)])
    lines = whole.read_bytes().splitlines(keepends=True)
    out.write_bytes(b"".join(lines[:-1]) + lines[-1][:20])
    assert run(["score", str(three), "--out", str(out)]) == 3
    assert out.read_bytes() == whole.read_bytes()


@pytest.fixture
def stuck_batch(three, tmp_path):
    """A batch that has written six reports and waits for its seventh recording, a pipe that nobody fills."""
    folder, out = tmp_path / "many", tmp_path / "out.jsonl"
    folder.mkdir()
    for number in range(12):
        (folder / f"{number:02}.csv").symlink_to(three / "s1.csv")
    pipe = folder / "06.csv"
    pipe.unlink()
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "inhalemon", "score", folder, "--device", "pmdi", "--jobs", "2", "--out", out]
    with subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True) as batch:
        while not out.exists() or out.read_bytes().count(b"\n") < 6:
            assert batch.poll() is None
            time.sleep(0.01)
        yield batch, pipe, out
        batch.kill()


def test_a_killed_batch_goes_on_where_it_stopped(stuck_batch, three):
    batch, pipe, out = stuck_batch
    batch.kill()
    os.close(os.open(pipe, os.O_RDWR))  # lets the worker go that waits for it
    pipe.unlink()
    pipe.symlink_to(three / "s1.csv")
    assert out.read_bytes().count(b"\n") == 6
    again = inhalemon("score", pipe.parent, "--device", "pmdi", "--jobs", "2", "--out", out)
    assert again.returncode == 0
    assert ids(documents(out.read_bytes())) == [f"{number:02}" for number in range(12)]


@pytest.mark.parametrize(("asked", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interruption_is_quiet_and_keeps_what_is_done(stuck_batch, three, asked, code):
    batch, pipe, out = stuck_batch
    os.killpg(batch.pid, asked)  # as the terminal does: to the parent and every worker
    _, told = batch.communicate(timeout=30)
    assert (batch.returncode, told) == (code, b"")
    assert ids(documents(out.read_bytes())) == [f"{number:02}" for number in range(6)]
    pipe.unlink()
    pipe.symlink_to(three / "s1.csv")
    assert inhalemon("score", pipe.parent, "--device", "pmdi", "--jobs", "2", "--out", out).returncode == 0
    assert ids(documents(out.read_bytes())) == [f"{number:02}" for number in range(12)]


def test_results_that_lie_among_the_recordings_are_none(good):
    out = good / "out.csv"
    assert run(["score", str(good), "--out", str(out)]) == 0
    before = out.read_bytes()
    assert run(["score", str(good), "--out", str(out)]) == 0
    assert out.read_bytes() == before


def test_sessions_of_one_name_are_counted_not_merged(three, tmp_path):
    out = tmp_path / "out.jsonl"
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.csv").write_bytes((three / "s1.csv").read_bytes())
    assert run(["score", str(tmp_path / "a"), "--device", "pmdi", "--out", str(out)]) == 0
    assert run(["score", str(tmp_path), "--device", "pmdi", "--out", str(out)]) == 0
    assert ids(documents(out.read_bytes())) == ["same", "same"]


@pytest.mark.parametrize("form", ["jsonl", "csv", "json"])
def test_reports_of_other_settings_are_not_mixed_into_one_file(three, tmp_path, form, capsys):
    out, settings = tmp_path / f"out.{form}", tmp_path / "s.toml"
    settings.write_text("[attitude]\nsmooth = false\n")
    path = str(three / "s0.csv")
    assert run(["score", path, "--out", str(out)]) == 0
    before = out.read_bytes()
    assert run(["score", path, "--out", str(out), "--settings", str(settings)]) == 2
    assert run(["score", path, "--out", str(out), "--rules", "strict"]) == 2
    assert out.read_bytes() == before
    assert "other settings" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("content", ['{"format": "diary"}\n', '{"format": "diary"}', "a,b\n1,2\n3", "[1, 2]\n"])
@pytest.mark.parametrize("form", ["jsonl", "csv", "json"])
def test_a_file_that_is_something_else_is_left_alone(three, tmp_path, form, content):
    out = tmp_path / f"precious.{form}"
    out.write_text(content)
    assert run(["score", str(three), "--out", str(out)]) == 2
    assert out.read_text() == content


def test_scoring_one_file_cold_imports_nothing_heavy(three):
    """`make validate` measures it on an idle machine (0.5 s); here other tests run beside it."""
    assert inhalemon("score", three / "s1.csv").returncode == 0
    assert least_processor_s(lambda: inhalemon("score", three / "s1.csv")) < 1.5


def test_piped_tables_have_no_colours_and_a_terminal_has(three):
    assert b"\x1b" not in inhalemon("score", three / "s1.csv").stdout
    plain = terminal_output(three / "s1.csv", {"NO_COLOR": "1"})
    assert b"\x1b[1;31m" not in plain
    assert b"\x1b[3" not in plain
    assert b"\x1b[" in terminal_output(three / "s1.csv", {"NO_COLOR": ""})


def terminal_output(path, environment):
    """What the program writes when its output is a terminal."""
    ours, theirs = os.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", **environment}
    command = [sys.executable, "-m", "inhalemon", "score", path]
    with subprocess.Popen(command, stdout=theirs, stderr=subprocess.DEVNULL, env=environment):
        os.close(theirs)
        written = b""
        try:
            while chunk := os.read(ours, 65536):
                written += chunk
        except OSError:  # Linux says so when the other side has closed
            pass
    os.close(ours)
    return written
