"""A real server on a free port, real workers, a real database: SQLite in a folder of its own, or PostgreSQL.

One server serves a whole run of tests; each test has clinics of its own, and so sees nothing of the others.
"""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from running import Clinic, Server, next_name, serving, settings_for

import inhalemon as im
from inhalemon.recording import write_recording

_POSTGRES_BIN = [Path("/usr/lib/postgresql"), Path("/usr/local/pgsql"), Path("/usr/local")]


# ------------------------------------------------------------------------------------------ databases


def _postgres_program(name: str) -> str | None:
    found = shutil.which(name)
    if found is not None:
        return str(Path(found).resolve())
    candidates = sorted(each for root in _POSTGRES_BIN for each in root.glob(f"*/bin/{name}"))
    return str(candidates[-1]) if candidates else None


@pytest.fixture(scope="session")
def postgresql(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a cluster made for this run; it refuses to run as root, so then it runs as somebody else."""
    initdb, pg_ctl = _postgres_program("initdb"), _postgres_program("pg_ctl")
    if initdb is None or pg_ctl is None:
        pytest.skip("PostgreSQL is not installed: apt-get install postgresql")
    folder = Path(f"/tmp/inhalemon-pg-{os.getpid()}")  # a socket's path must be short
    folder.mkdir(mode=0o755)
    runner: list[str] = []
    if os.geteuid() == 0:
        runner = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
        shutil.chown(folder, "nobody", "nogroup")
    data = folder / "data"
    run = functools.partial(subprocess.run, check=True, capture_output=True, cwd="/")
    try:
        run([*runner, initdb, "-D", str(data), "-U", "tester", "-A", "trust", "--no-sync", "-E", "UTF8", "--locale=C"])
        options = f"-c listen_addresses= -c unix_socket_directories={folder} -c max_connections=200"
        run([*runner, pg_ctl, "-D", str(data), "-w", "-o", options, "-l", str(folder / "log"), "start"])
        try:
            yield f"postgresql://tester@/postgres?host={folder}"
        finally:
            run([*runner, pg_ctl, "-D", str(data), "-m", "immediate", "stop"])
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session", params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def database(request: pytest.FixtureRequest) -> Callable[[], str | None]:
    """Gives the URL of a fresh database each time it is called; `None` is SQLite in the data folder."""
    if request.param == "sqlite":
        return lambda: None
    import psycopg  # noqa: PLC0415  # an extra

    url: str = request.getfixturevalue("postgresql")

    def fresh() -> str:
        name = f"test_{os.getpid()}_{next_name()}"
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return url.replace("/postgres?", f"/{name}?")

    return fresh


# ------------------------------------------------------------------------------------------ server


@pytest.fixture(scope="session")
def server(database: Callable[[], str | None], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(settings_for(tmp_path_factory.mktemp("data"), database(), workers=1)) as running:
        yield running


@pytest.fixture
def new_clinic(server: Server) -> Iterator[Callable[[], Clinic]]:
    """Makes clinics for one test."""
    made: list[Clinic] = []

    def make() -> Clinic:
        made.append(server.clinic())
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def clinic(new_clinic: Callable[[], Clinic]) -> Clinic:
    return new_clinic()


@pytest.fixture
def other_clinic(new_clinic: Callable[[], Clinic]) -> Clinic:
    return new_clinic()


# ------------------------------------------------------------------------------------------ recordings


@functools.cache
def _simulated(device: str, mistakes: tuple[str, ...], seed: int, folder: str) -> bytes:
    recording, _ = im.simulate_session(device, mistakes=mistakes, seed=seed, rate_hz=50.0)
    path = Path(folder) / f"{device}-{seed}.csv"
    write_recording(recording, path)
    return path.read_bytes()


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., bytes]:
    """A simulated session's file; another `seed` gives other bytes, of one of four sessions."""
    folder = str(tmp_path_factory.mktemp("recordings"))

    def make(device: str = "pmdi", mistakes: tuple[str, ...] = (), seed: int = 1) -> bytes:
        return _simulated(device, mistakes, seed % 4, folder) + b"\n" * (seed // 4)

    return make


@pytest.fixture
def upload(recording: Callable[..., bytes]) -> Callable[..., dict[str, object]]:
    """Uploads a simulated session, and gives the answer's JSON."""

    def send(clinic: Clinic, *, seed: int = 1, device: str = "pmdi", **metadata: object) -> dict[str, object]:
        content = recording(device, seed=seed)
        params = {"device": device, **{name: str(value) for name, value in metadata.items()}}
        answer = clinic.client("clinician").post(
            "/v1/sessions", content=content, params=params, headers={"content-type": "text/csv"}
        )
        assert answer.status_code in {200, 201}, answer.text
        told: dict[str, object] = answer.json()
        return told

    return send
