"""serve becomes the service: its options, its exit code and every signal are the service's own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip("fastapi", reason="the service's extra is not installed")


def serve(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "inhalemon", "serve", *arguments], capture_output=True, check=False, text=True, **options
    )


def test_options_and_exit_code_are_those_of_the_service():
    told = serve("--help")
    assert told.returncode == 0
    assert "--with-samples" in told.stdout
    assert serve("--nonsense").returncode == 2


@pytest.mark.parametrize(
    ("kill", "number"), [(os.killpg, signal.SIGINT), (os.kill, signal.SIGTERM), (os.kill, signal.SIGHUP)]
)
def test_a_signal_ends_the_service_and_leaves_nothing_running(tmp_path, kill, number):
    """Ctrl-C reaches the whole group, as the terminal sends it; a supervisor's SIGTERM the one process it started."""
    command = [sys.executable, "-m", "inhalemon", "serve", "--port", "0", "--data-dir", tmp_path / "data"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, start_new_session=True, **streams) as program:
        said = ""
        for line in program.stdout:
            said += line
            if "http://" in line:
                break
        assert "http://" in said, said
        kill(program.pid, number)
        rest, _ = program.communicate(timeout=60)
    assert program.returncode in (0, 128 + number, -number), said + rest
    assert "Traceback" not in rest
    with pytest.raises(ProcessLookupError):
        os.killpg(program.pid, 0)
