"""Time and memory of the whole way, from the file's bytes to the report, as a user pays for it."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import inhalemon as im
from validation import profile
from validation.lengthened import session_of
from validation.tables import Table, Target

REPEATS = 45


def tables() -> list[Table]:
    """Scoring one session and where the time goes, starting cold, cost against length, and a batch on all cores."""
    with tempfile.TemporaryDirectory() as folder:
        return [_one_session(Path(folder)), profile.table(), _against_length(Path(folder)), _batch(Path(folder))]


_WARM = """
import statistics, sys, time
import inhalemon as im
from inhalemon.report import to_json

samples = []
for _ in range(int(sys.argv[2])):
    start = time.process_time()
    to_json(im.score_recording(im.read_recording(sys.argv[1], device="pmdi")))
    samples.append(time.process_time() - start)
print(statistics.median(samples[5:]))
"""


def _cpu_ms(path: Path) -> float:
    """Median CPU time of reading, scoring and writing the report's JSON, warm, in a process that does nothing else."""
    command = [sys.executable, "-c", _WARM, str(path), str(REPEATS)]
    return 1e3 * float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _one_session(folder: Path) -> Table:
    path = folder / "session.csv"
    im.write_recording(session_of(60.0), path)
    warm_ms = _cpu_ms(path)
    help_s = _wall_s([sys.executable, "-m", "inhalemon", "--help"])
    cold_s = _wall_s([sys.executable, "-m", "inhalemon", "score", str(path), "--device", "pmdi", "--format", "json"])
    return Table(
        title="One session",
        measured_on="a simulated 60 s, 100 Hz, two-sensor pMDI session as CSV (12,000 rows)",
        columns=("what", "measured"),
        rows=(
            ("parse to report, warm, CPU", f"{warm_ms:.1f} ms"),
            ("`inhalemon --help`, cold", f"{help_s:.2f} s"),
            ("`inhalemon score FILE`, cold", f"{cold_s:.2f} s"),
        ),
        targets=(
            Target("parse to report, warm", warm_ms, 20.0, "ms"),
            Target("help, cold", help_s, 0.3, "s"),
            Target("scoring one file, cold", cold_s, 1.5, "s"),
        ),
    )


def _wall_s(command: list[str]) -> float:
    samples = []
    for _ in range(5):
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        samples.append(time.perf_counter() - start)
    return statistics.median(samples)


def _against_length(folder: Path) -> Table:
    """CPU and peak memory of a fresh process for each length."""
    rows, seconds, cpu = [], (10.0, 60.0, 600.0, 3600.0), []
    peak_mb = 0.0
    for length in seconds:
        path = folder / f"{length:.0f}.csv"
        im.write_recording(session_of(length), path)
        code = (
            "import re, sys, time, inhalemon as im\n"
            "im.score_recording(im.read_recording(sys.argv[2], device='pmdi'))\n"  # imports and caches
            "start = time.process_time()\n"
            "im.score_recording(im.read_recording(sys.argv[1], device='pmdi'))\n"
            # The process's own peak: getrusage's counts that of the process it was forked from.
            "peak_kb = re.search('VmHWM:[^0-9]*([0-9]+)', open('/proc/self/status').read())[1]\n"
            "print(time.process_time() - start, int(peak_kb) / 1024)"
        )
        command = [sys.executable, "-c", code, str(path), str(folder / "10.csv")]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        cpu_s, peak_mb = (float(value) for value in done.stdout.split())
        cpu.append(cpu_s)
        rows.append((f"{length:.0f} s", f"{1e3 * cpu_s:.0f} ms", f"{1e3 * cpu_s / length:.2f} ms", f"{peak_mb:.0f} MB"))
    slope = float(np.polyfit(np.log(seconds[1:]), np.log(cpu[1:]), 1)[0])
    return Table(
        title="Cost against length",
        measured_on="simulated pMDI sessions at 100 Hz, repeated to the length; a fresh process each",
        columns=("length", "CPU", "CPU a second of recording", "peak RSS"),
        rows=tuple(rows),
        targets=(
            Target("growth of CPU with length, exponent from 1 min to 1 h", slope, 1.1),
            Target("peak memory at 1 h", peak_mb, 450.0, "MB"),
        ),
    )


def _batch(folder: Path, n_sessions: int = 500) -> Table:
    """Sessions a second of `inhalemon score FOLDER`, and the memory of all its processes."""
    batch = folder / "batch"
    batch.mkdir()
    for k in range(20):
        recording, _ = im.simulate_session(("pmdi", "ellipta")[k % 2], seed=k)
        im.write_recording(recording, batch / f"{k:03d}.csv")
    originals = sorted(batch.glob("*.csv"))
    for k in range(20, n_sessions):
        source = originals[k % 20]
        for suffix in (".csv", ".json"):
            (batch / f"{k:03d}{suffix}").hardlink_to(source.with_suffix(suffix))
    command = [sys.executable, "-m", "inhalemon", "score", str(batch), "--format", "jsonl", "--out"]
    start = time.perf_counter()
    child = subprocess.Popen([*command, str(folder / "out.jsonl")], stdout=subprocess.DEVNULL)
    peak_mb = 0.0
    while child.poll() is None:
        peak_mb = max(peak_mb, _family_pss_mb(child.pid))
        time.sleep(0.1)
    seconds = time.perf_counter() - start
    if child.returncode != 0:
        raise RuntimeError(f"the batch ended with exit code {child.returncode}")
    rate = n_sessions / seconds
    return Table(
        title="A batch",
        measured_on=f"{n_sessions} files of 20 simulated sessions of 20-35 s at 100 Hz, {os.cpu_count()} cores",
        columns=("what", "measured"),
        rows=(
            ("sessions a second, start included", f"{rate:.0f}"),
            ("peak memory of all processes (PSS)", f"{peak_mb:.0f} MB"),
        ),
        targets=(
            Target("sessions a second", rate, 60.0, "/s", at_least=True),
            Target("peak memory", peak_mb, 500.0, "MB"),
        ),
    )


def _family_pss_mb(pid: int) -> float:
    """Proportional set size of a process and its descendants, MB; 0 where the kernel does not tell."""
    total = 0.0
    waiting = [pid]
    while waiting:
        one = waiting.pop()
        try:
            rollup = Path(f"/proc/{one}/smaps_rollup").read_text(encoding="ascii")
            total += sum(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:")) / 1024
            for task in Path(f"/proc/{one}/task").iterdir():
                waiting += [int(child) for child in (task / "children").read_text(encoding="ascii").split()]
        except OSError:
            continue  # it ended meanwhile
    return total


if __name__ == "__main__":
    for table in tables():
        print(table.to_markdown())
    print(f"peak RSS of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
