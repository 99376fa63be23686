"""What the service does in a second, on this machine, with its client beside it: `python -m benchmarks.api`.

A real server with its workers and SQLite in a folder of its own; simulated sessions of 30 s at 100 Hz, each with other
bytes; 100,000 stored sessions for the list. Every request goes to 127.0.0.1, and their number is bounded.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import inhalemon as im
from api import operations
from api.moments import DAY_US, new_id, now_us
from api.principal import Role
from api.settings import load
from api.store import Store, people, tables
from inhalemon.recording import write_recording
from inhalemon.values import ImuTrack

N_UPLOADS = 900
N_CLIENTS = 4
N_STORED = 100_000
N_PAGES = 300
N_SERIES = 300
LENGTH_S = 30.0
CHANNELS = (
    "tilt_deg,tilt_sd_deg,angle_deg,angle_sd_deg,off_axis_deg,gyr_x_deg_s,gyr_y_deg_s,gyr_z_deg_s,"
    "acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,r"
)


def main() -> int:
    """Print each number beside its target; 1 when one is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uploads", type=int, default=N_UPLOADS)
    parser.add_argument("--stored", type=int, default=N_STORED)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="inhalemon-bench-") as folder:
        data_dir = Path(folder)
        bodies = _bodies(data_dir)
        many_key, key = _prepare(data_dir / "data", given.stored)
        rows: list[Row] = []
        with _server(data_dir / "data") as (child, port, ready_s):
            rows.append(_row("ready after", ready_s, "s", 2.5))
            _wait_for_workers(port, key, bodies)
            before = _cpu_s(child.pid)
            rows += _uploads(port, key, bodies, given.uploads)
            server_s, workers_s = (after - start for after, start in zip(_cpu_s(child.pid), before, strict=True))
            memory_mb = _pss_mb(child.pid)
            rows += _lists(port, many_key, given.stored)
            rows += _series(port, key)
            rows.append(_row("memory (PSS), workers included", max(memory_mb, _pss_mb(child.pid)), "MB", 450.0))
    width = max(len(row[0]) for row in rows)
    for name, value, unit, target, is_met in rows:
        print(f"{name:<{width}}  {value:9.1f} {unit:<3}  target {target:<9} {'met' if is_met else 'MISSED'}")
    cpu_ms = [1000 * each / given.uploads for each in (server_s, workers_s)]
    print(f"CPU a session: server {cpu_ms[0]:.1f} ms, workers {cpu_ms[1]:.1f} ms")
    print(f"load of the machine over the last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return 0 if all(row[-1] for row in rows) else 1


Row = tuple[str, float, str, str, bool]  # name, value, unit, target, whether it is met


def _row(name: str, value: float, unit: str, limit: float, *, at_least: bool = False) -> Row:
    is_met = value >= limit if at_least else value < limit
    return name, value, unit, f"{'>=' if at_least else '<'} {limit:g} {unit}", is_met


# ------------------------------------------------------------------------------------------ preparing


def _bodies(folder: Path) -> list[bytes]:
    """Simulated sessions of 30 s at 100 Hz, as files."""
    bodies = []
    for seed in range(4):
        recording, _ = im.simulate_session("pmdi", seed=seed, rate_hz=100.0)
        path = folder / f"{seed}.csv"
        write_recording(replace(recording, body=_first(recording.body), lever=_first(recording.lever)), path)
        bodies.append(path.read_bytes())
    return bodies


def _first(track: ImuTrack) -> ImuTrack:
    """The first 30 s; a shorter session goes on lying on the table, with the noise of its last second."""
    step_s = 1.0 / track.rate_hz
    missing = round((LENGTH_S - (track.time_s[-1] - track.time_s[0])) / step_s)
    if missing > 0:
        more = np.arange(1, missing + 1)
        index = track.n_samples - 100 + (more - 1) % 100
        track = ImuTrack(
            np.concatenate([track.time_s, track.time_s[-1] + more * step_s]),
            np.concatenate([track.acc_m_s2, track.acc_m_s2[index]]),
            np.concatenate([track.gyr_rad_s, track.gyr_rad_s[index]]),
        )
    kept = track.time_s - track.time_s[0] < LENGTH_S
    return ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])


def _prepare(data_dir: Path, n_stored: int) -> tuple[str, str]:
    """A database with a clinic of many sessions and an empty one; a key of each."""
    with operations.opened(load(data_dir=data_dir)) as service:
        many, few = (operations.add_key(service, slug, Role.CLINICIAN).key for slug in ("many", "few"))
        with service.store.read() as connection:
            clinic_id = people.clinic_slugs(connection)["many"]
        _fill(service.store, clinic_id, n_stored)
    return many, few


def _fill(store: Store, clinic_id: str, n: int) -> None:
    now = now_us()
    grades = ("correct", "minor_mistakes", "not_assessable", "major_mistakes", "critical_mistakes")
    for first in range(0, n, 5000):
        rows, found = [], []
        for k in range(first, min(n, first + 5000)):
            session_id = new_id()
            grade = k % 5
            rows.append(
                {
                    "id": session_id,
                    "clinic_id": clinic_id,
                    "sha256": f"{k:064x}",
                    "n_bytes": 300_000,
                    "suffix": ".csv",
                    "device": "pmdi",
                    "patient_ref": f"P-{k % 2000}",
                    "happened_at_us": now - k * DAY_US // 500,
                    "uploaded_at_us": now,
                    "uploaded_by": "benchmark",
                    "state": "scored",
                    "grade": grades[grade],
                    "merit": 4 - grade,
                    "points": 100 - 20 * grade,
                    "attempts": 0,
                    "n_reviews": 0,
                    "duration_s": 30.0,
                }
            )
            found += [
                {"session_id": session_id, "rule": rule, "verdict": "fail", "severity": "major", "clinic_id": clinic_id}
                for rule in ("press_late", "no_exhale_pause", "breath_hold_too_short")[: grade % 4]
            ]
        with store.write() as connection:
            connection.execute(tables.sessions.insert(), rows)
            connection.execute(tables.findings.insert(), found)


@contextlib.contextmanager
def _server(data_dir: Path) -> Iterator[tuple[subprocess.Popen[str], int, float]]:
    """The service as an operator starts it, and how long it took to be ready."""
    environment = os.environ | {"INHALEMON_DATA_DIR": str(data_dir), "INHALEMON_KEY_REQUESTS_PER_MINUTE": "1000000"}
    command = [sys.executable, "-m", "api", "serve", "--port", "0"]
    started_s = time.perf_counter()
    with (data_dir / "log").open("w") as log:
        child = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            assert child.stdout is not None
            told = child.stdout.readline()
            found = re.search(r":(\d+)/", told)
            if found is None:
                raise SystemExit(f"the server did not start: {(data_dir / 'log').read_text()}")
            port = int(found[1])
            while True:
                with contextlib.suppress(OSError, http.client.HTTPException):
                    if _Client(port, None).get("/readyz")[0] == 200:
                        break
                time.sleep(0.01)
            yield child, port, time.perf_counter() - started_s
        finally:
            child.terminate()
            child.wait(20)
            assert child.stdout is not None
            child.stdout.close()


# ------------------------------------------------------------------------------------------ measuring


class _Client:
    """A connection that stays open; as light as Python has it, for it shares the cores with the server."""

    def __init__(self, port: int, key: str | None) -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        self._headers = {} if key is None else {"Authorization": f"Bearer {key}"}

    def get(self, path: str, **headers: str) -> tuple[int, bytes]:
        self._connection.request("GET", path, headers=self._headers | headers)
        answer = self._connection.getresponse()
        return answer.status, answer.read()

    def post(self, path: str, body: bytes) -> tuple[int, bytes]:
        self._connection.request("POST", path, body, self._headers | {"Content-Type": "text/csv"})
        answer = self._connection.getresponse()
        return answer.status, answer.read()


def _timed(ask: Callable[[], tuple[int, bytes]], wanted: Sequence[int]) -> float:
    started_s = time.perf_counter()
    status, body = ask()
    took_s = time.perf_counter() - started_s
    if status not in wanted:
        raise SystemExit(f"answered {status}: {body[:300]!r}")
    return took_s


def _p99_ms(times_s: Sequence[float]) -> float:
    return float(np.percentile(times_s, 99) * 1000)


def _wait_for_workers(port: int, key: str, bodies: Sequence[bytes]) -> None:
    client = _Client(port, key)
    for body in bodies:
        _timed(lambda body=body: client.post("/v1/sessions?device=pmdi", body), (201,))  # type: ignore[misc]
    threads = [threading.Thread(target=_Client(port, key).get, args=("/version",)) for _ in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    time.sleep(3.0)  # the second worker loads the library as well


def _uploads(port: int, key: str, bodies: Sequence[bytes], n: int) -> list[Row]:
    numbers = itertools.count(1)
    times_s: list[float] = []
    lock = threading.Lock()

    def run() -> None:
        client = _Client(port, key)
        while True:
            with lock:
                number = next(numbers)
            if number > n:
                return
            body = bodies[number % len(bodies)] + b"\n" * number  # other bytes, the same samples
            times_s.append(_timed(lambda body=body: client.post("/v1/sessions?device=pmdi", body), (201,)))  # type: ignore[misc]

    threads = [threading.Thread(target=run) for _ in range(N_CLIENTS)]
    started_s = time.perf_counter()
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    rate = n / (time.perf_counter() - started_s)
    return [
        _row(f"upload and score, {N_CLIENTS} clients, {n} sessions", rate, "/s", 60.0, at_least=True),
        _row("upload and score, p99", _p99_ms(times_s), "ms", 250.0),
    ]


def _lists(port: int, key: str, n_stored: int) -> list[Row]:
    client = _Client(port, key)
    rows = []
    orders = {"newest first": "", "worst first": "&order=worst", "one mistake": "&rule=press_late&verdict=fail"}
    for name, query in orders.items():
        times_s, cursor = [], ""
        for _ in range(N_PAGES):
            started_s = time.perf_counter()
            status, body = client.get(f"/v1/sessions?limit=50{query}{cursor}")
            times_s.append(time.perf_counter() - started_s)
            if status != 200:
                raise SystemExit(f"answered {status}: {body[:300]!r}")
            following = json.loads(body)["next"]
            cursor = "" if following is None else f"&cursor={following}"
        rows.append(_row(f"page of 50 of {n_stored:,}, {name}, p99", _p99_ms(times_s), "ms", 25.0))
    return rows


def _series(port: int, key: str) -> list[Row]:
    client = _Client(port, key)
    ids = [each["id"] for each in json.loads(client.get("/v1/sessions?limit=5")[1])["items"]]
    rows = []
    for form in ("json", "binary"):
        paths = [f"/v1/sessions/{each}/series?channels={CHANNELS}&max_points=1500&format={form}" for each in ids]
        for path in paths:
            client.get(path)  # the first look computes, and keeps what it computed
        times_s = [
            _timed(lambda path=path: client.get(path), (200,))  # type: ignore[misc]
            for path in itertools.islice(itertools.cycle(paths), N_SERIES)
        ]
        rows.append(_row(f"series, 12 channels x 1500 points, {form}, p99", _p99_ms(times_s), "ms", 40.0))
    return rows


def _cpu_s(pid: int) -> tuple[float, float]:
    """The CPU time of a process so far, and that of its children."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return _own_cpu_s(pid), sum(_own_cpu_s(int(child)) for child in children)


def _own_cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _pss_mb(pid: int) -> float:
    """Proportional memory of a process and its children."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    own = int(next(line.split()[1] for line in text.splitlines() if line.startswith("Pss:"))) / 1024
    return own + sum(_pss_mb(int(child)) for child in children)


if __name__ == "__main__":
    raise SystemExit(main())
