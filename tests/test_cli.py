"""The command line as a whole: exit codes, streams, speed; the verbs have tests of their own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import pytest
from clock import least_processor_s

from inhalemon import __version__
from inhalemon.cli import run

LABELS = {"format": "inhalemon-labels/1", "session_id": "a", "mistakes": ["no_press"]}
REPORT = {
    "format": "inhalemon-report/1",
    "session_id": "a",
    "findings": [{"rule": "no_press", "verdict": "fail"}],
}


def inhalemon(*arguments, **options):
    """The real program in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "inhalemon", *map(str, arguments)], capture_output=True, check=False, **options
    )


@pytest.fixture
def documents(tmp_path):
    (tmp_path / "a.truth.json").write_text(json.dumps(LABELS))
    (tmp_path / "reports.jsonl").write_text(json.dumps(REPORT) + "\n")
    return tmp_path


def test_version_is_that_of_the_package(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"inhalemon {__version__}\n"


def test_help_names_every_exit_code(capsys):
    assert run(["--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "0 done, whatever the score; 2 usage; 3 some recording could not be used; 4 bad settings or rules" in said


def test_help_answers_at_once_and_loads_nothing_heavy():
    """The target is 0.3 s on an idle machine, and `make validate` measures it; here other tests run beside it."""
    assert least_processor_s(lambda: inhalemon("--help")) < 0.5
    told = inhalemon("--help", env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"})
    assert told.returncode == 0
    loaded = set(re.findall(r"\| +([\w.]+)$", told.stderr.decode(), flags=re.MULTILINE))
    assert "typer" in loaded
    assert not loaded & {"numpy", "scipy", "sklearn", "orjson", "pyarrow", "inhalemon.values"}


@pytest.mark.parametrize("arguments", [["nonsense"], ["evaluate"], ["evaluate", "x", "y", "--format", "xml"]])
def test_wrong_usage_leaves_with_2(arguments):
    assert run(arguments) == 2


def test_evaluate_prints_counts_as_a_table_and_as_json(documents, capsys):
    assert run(["evaluate", str(documents / "reports.jsonl"), str(documents)]) == 0
    said = capsys.readouterr().out
    assert re.search(r"no_press\D+1\D+0\D+0\D+1\.00", said)
    assert "macro F1 1.000" in said
    out = documents / "evaluation.json"
    assert run(["evaluate", str(documents), str(documents), "--format", "json", "--out", str(out)]) == 0
    found = json.loads(out.read_bytes())
    assert found["format"] == "inhalemon-evaluation/1"
    assert found["rules"]["no_press"]["agreement"]["tp"] == 1
    assert capsys.readouterr().out == ""


def test_evaluate_reads_reports_from_standard_input(documents):
    told = inhalemon("evaluate", "-", documents, input=json.dumps([REPORT]).encode())
    assert told.returncode == 0, told.stderr
    assert b"1 sessions" in told.stdout


def test_labels_that_do_not_fit_are_told_in_one_line_without_a_traceback(documents):
    (documents / "a.truth.json").write_text(json.dumps({**LABELS, "session_id": "b"}))
    told = inhalemon("evaluate", documents / "reports.jsonl", documents)
    assert told.returncode == 2
    assert told.stdout == b""
    assert told.stderr.decode().count("\n") == 1
    assert told.stderr.startswith(b"inhalemon: none of 1 labelled sessions")


def test_a_file_that_is_no_json_is_told_with_its_line(documents, capsys):
    (documents / "reports.jsonl").write_text(json.dumps(REPORT) + "\n{half")
    assert run(["evaluate", str(documents / "reports.jsonl"), str(documents)]) == 2
    assert "reports.jsonl line 2" in capsys.readouterr().err


def test_a_missing_file_is_told_in_one_line(documents, capsys):
    assert run(["evaluate", "nowhere.jsonl", str(documents)]) == 2
    assert capsys.readouterr().err == "inhalemon: nowhere.jsonl: No such file or directory\n"


def test_output_that_nobody_reads_ends_quietly(documents):
    """As in `inhalemon ... | head -0`: the reader has closed the pipe before anything was written."""
    reading, writing = os.pipe()
    os.close(reading)
    told = subprocess.run(
        [sys.executable, "-m", "inhalemon", "evaluate", documents / "reports.jsonl", documents],
        stdout=writing,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writing)
    assert told.stderr == b""
    assert told.returncode == 1


@pytest.mark.parametrize("environment", [{}, {"NO_COLOR": "1", "FORCE_COLOR": ""}])
def test_piped_output_has_no_colours(documents, environment):
    told = inhalemon("evaluate", documents / "reports.jsonl", documents, env={**os.environ, **environment})
    assert b"\x1b" not in told.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shell_completion_can_be_shown(shell):
    told = inhalemon(env={**os.environ, "_INHALEMON_COMPLETE": f"source_{shell}"})
    assert told.returncode == 0, told.stderr
    assert b"inhalemon" in told.stdout
