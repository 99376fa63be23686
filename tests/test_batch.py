"""Batches in real processes: order, crashes, interruption, and what is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from inhalemon.cli.batch import run_batch
from inhalemon.cli.sources import sources


def slow_then_quick(number: int) -> int:
    time.sleep(0.02 if number % 7 == 0 else 0.0)
    return number * number


def dies_at_three(number: int) -> str:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return str(number)


def after_the_sign(sign: Path | None) -> str:
    if sign is None:
        return "at once"
    deadline = time.monotonic() + 60
    while not sign.exists() and time.monotonic() < deadline:
        time.sleep(0.005)
    return "after the sign" if sign.exists() else "too late"


def process_of(number: int) -> int:
    time.sleep(0.01)
    return os.getpid()


def crashed(job: int, exit_code: int | None) -> str:
    return f"{job} died of {exit_code}"


@pytest.mark.parametrize("n_workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs(n_workers):
    found = list(run_batch(slow_then_quick, range(200), n_workers=n_workers, on_crash=lambda job, code: -1))
    assert found == [number * number for number in range(200)]


def test_the_work_is_shared_by_other_processes():
    found = set(run_batch(process_of, range(20), n_workers=2, on_crash=lambda job, code: -1))
    assert len(found) == 2
    assert os.getpid() not in found


def test_a_killed_worker_costs_its_own_job_alone():
    found = list(run_batch(dies_at_three, range(8), n_workers=2, on_crash=crashed))
    assert found == ["0", "1", "2", f"3 died of {-signal.SIGKILL}", "4", "5", "6", "7"]


def test_first_results_are_there_before_the_last_job_is_done(tmp_path):
    """The last job waits for a file that is made once the first result has come."""
    sign = tmp_path / "sign"
    results = run_batch(after_the_sign, [None, None, sign], n_workers=2, on_crash=lambda job, code: "died")
    assert next(results) == "at once"
    sign.touch()
    assert list(results) == ["at once", "after the sign"]


def test_workers_end_when_their_parent_is_killed(tmp_path):
    """Nobody is left to close the pipes by name: the kernel does it, and a worker takes that as its end."""
    script = tmp_path / "batch.py"
    script.write_text(
        "import os, time\n"
        "from inhalemon.cli.batch import run_batch\n"
        "def nap(job):\n"
        "    time.sleep(0.05)\n"
        "    return os.getpid()\n"
        "if __name__ == '__main__':\n"
        "    for pid in run_batch(nap, range(1000), n_workers=2, on_crash=lambda job, code: -1):\n"
        "        print(pid, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as parent:
        workers = {int(parent.stdout.readline()) for _ in range(6)}
        parent.kill()
    deadline = time.monotonic() + 10
    while workers and time.monotonic() < deadline:
        workers = {pid for pid in workers if is_running(pid)}
        time.sleep(0.02)
    assert not workers


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.1, 0.2, 0.3])
def test_an_interrupt_is_seen_whenever_it_comes(tmp_path, delay_s):
    """As workers start, between results, while a result is taken: the whole group gets it, as from a terminal."""
    script = tmp_path / "batch.py"
    script.write_text(
        "import sys\n"
        "from inhalemon.cli.batch import run_batch\n"
        "def quick(job):\n"
        "    return job\n"
        "if __name__ == '__main__':\n"
        "    results = run_batch(quick, range(10**5), n_workers=2, on_crash=lambda job, code: sys.exit('crashed'))\n"
        "    whole = True\n"
        "    print('started', flush=True)\n"
        "    try:\n"
        "        for result in results:\n"
        "            whole = False\n"
        "            whole = True\n"
        "    except KeyboardInterrupt:\n"
        "        print(whole, flush=True)\n"
    )
    command = [sys.executable, script]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as parent:
        assert parent.stdout.readline() == "started\n"
        time.sleep(0.1 + delay_s)
        os.killpg(parent.pid, signal.SIGINT)
        assert parent.communicate(timeout=30) == ("True\n", "")
        assert parent.returncode == 0


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_folders_are_walked_for_recordings_alone(tmp_path):
    for name in (
        "b.csv",
        "a.csv.gz",
        "deep/c.parquet",
        "deep/D.CSV.ZST",
        "a.json",
        "a.truth.json",
        ".hidden/x.csv",
        ".x.csv",
    ):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    found = [source.name for source in sources([str(tmp_path), str(tmp_path / "b.csv"), "odd.name"])]
    inside = ["a.csv.gz", "b.csv", "deep/D.CSV.ZST", "deep/c.parquet"]
    assert found == [*(str(tmp_path / name) for name in inside), "odd.name"]


def test_a_folder_without_recordings_is_told(tmp_path):
    with pytest.raises(FileNotFoundError, match="no recordings in this folder"):
        sources([str(tmp_path)])
