"""Milliseconds of CPU for one session, from the file's bytes to the report's; `make bench` runs it."""

from __future__ import annotations

import time

import pytest

import inhalemon as im
from inhalemon.pipeline import estimate_tracks
from inhalemon.report import to_json
from validation.lengthened import session_of

SECONDS = 60.0


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("speed") / "session.csv"
    im.write_recording(session_of(SECONDS), path)
    return path


@pytest.fixture(scope="module")
def recording(path):
    return im.read_recording(path, device="pmdi")


def measure(benchmark, work) -> None:
    """CPU time, not the clock's: other work on the machine only adds."""
    benchmark._timer = time.process_time
    benchmark.extra_info["seconds of recording"] = SECONDS
    benchmark.pedantic(work, rounds=15, warmup_rounds=2)


def test_from_file_to_report(benchmark, path):
    measure(benchmark, lambda: to_json(im.score_recording(im.read_recording(path, device="pmdi"))))


def test_reading(benchmark, path):
    measure(benchmark, lambda: im.read_recording(path, device="pmdi"))


def test_tracks(benchmark, recording):
    measure(benchmark, lambda: estimate_tracks(recording))


def test_scoring(benchmark, recording):
    measure(benchmark, lambda: im.score_recording(recording))
