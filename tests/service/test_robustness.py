"""What happens when things go wrong: workers die, disks fill, clients stall, the power goes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest
from running import serving, settings_for

from api import operations
from api.principal import Role
from api.serving import BoundedHttp
from api.store import sessions

CSV = {"content-type": "text/csv"}


def send(client, content, **params):
    return client.post("/v1/sessions", content=content, params={"device": "pmdi", **params}, headers=CSV)


def wait_until(holds, seconds=40.0):
    deadline_s = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline_s, "it never came to that"
        time.sleep(0.05)


@contextlib.contextmanager
def own_server(tmp_path, database, **settings):
    """A server with settings of its own, and one clinic's clinician."""
    own = settings_for(tmp_path / "data", database(), **{"workers": 1, **settings})
    with serving(own) as server, contextlib.closing(server.clinic()) as clinic:
        yield server, clinic


# ------------------------------------------------------------------------------------------ workers


def test_a_crashed_worker_costs_one_answer_and_no_data(tmp_path, database, recording):
    with own_server(tmp_path, database) as (server, clinic):
        client = clinic.client("clinician")
        assert send(client, recording(seed=80)).status_code == 201
        (worker,) = server.service.pool.pids
        os.kill(worker, signal.SIGSTOP)  # so that it surely has the job when it dies
        killer = threading.Timer(0.5, os.kill, (worker, signal.SIGKILL))
        killer.start()
        answer = send(client, recording(seed=81))
        killer.join()
        assert answer.status_code == 500
        assert answer.headers["content-type"] == "application/problem+json"
        session = answer.json()["session"]
        assert session in answer.json()["detail"]
        kept = client.get(f"/v1/sessions/{session}").json()
        assert kept["state"] in {"unscored", "scored"}  # it is tried again soon
        assert send(client, recording(seed=82)).status_code == 201, "the next one is served by a new worker"
        wait_until(lambda: client.get(f"/v1/sessions/{session}").json()["state"] == "scored")
        assert client.get(f"/v1/sessions/{session}/recording").content == recording(seed=81)


def test_a_worker_that_dies_idle_is_replaced_and_costs_nothing(tmp_path, database, recording):
    """As the kernel may end it for want of memory."""
    with own_server(tmp_path, database) as (server, clinic):
        client = clinic.client("clinician")
        assert client.get("/version").status_code == 200
        (worker,) = server.service.pool.pids
        os.kill(worker, signal.SIGKILL)
        time.sleep(0.5)
        assert send(client, recording(seed=83)).status_code == 201
        assert server.service.pool.pids != [worker]


@pytest.mark.slow
def test_a_job_past_its_deadline_is_ended(tmp_path, database, recording):
    with own_server(tmp_path, database, score_deadline_s=2.0) as (server, clinic):
        client = clinic.client("clinician")
        assert client.get("/version").status_code == 200  # the worker is warm
        (worker,) = server.service.pool.pids
        os.kill(worker, signal.SIGSTOP)
        started_s = time.monotonic()
        answer = send(client, recording(seed=83))
        assert answer.status_code == 500
        assert 1.9 < time.monotonic() - started_s < 20
        wait_until(lambda: client.get(f"/v1/sessions/{answer.json()['session']}").json()["state"] == "scored")


def test_when_no_worker_starts_bytes_are_kept_and_nobody_waits_for_ever(tmp_path, database, recording):
    with own_server(tmp_path, database, score_deadline_s=2.0) as (server, clinic):
        pool = server.service.pool
        command = pool._command
        pool._command = (sys.executable, "-c", "raise SystemExit(3)")
        for worker in pool.pids:
            os.kill(worker, signal.SIGKILL)
        client = clinic.client("clinician")
        answer = send(client, recording(seed=87))
        assert answer.status_code == 503, answer.text
        assert int(answer.headers["retry-after"]) >= 1
        assert client.get(f"/v1/sessions/{answer.json()['session']}").json()["state"] == "unscored"
        assert client.get("/version").status_code == 503
        pool._command = command
        wait_until(lambda: client.get(f"/v1/sessions/{answer.json()['session']}").json()["state"] == "scored")


def _an_hour():
    """Two sensors at 100 Hz, at rest."""
    rows = [f"{n / 100:.2f},0,0,9.81,0,0,0" for n in range(359_000)]
    head = "sensor,time_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,gyr_x_rad_s,gyr_y_rad_s,gyr_z_rad_s"
    return "\n".join([head, *(f"{name},{row}" for name in ("body", "lever") for row in rows)]).encode()


def test_a_recording_that_needs_too_much_memory_is_refused_and_the_next_one_scored(tmp_path, database, recording):
    with own_server(tmp_path, database, worker_memory_bytes=256 * 2**20) as (_, clinic):
        client = clinic.client("clinician")
        answer = send(client, _an_hour())
        assert answer.status_code == 422, answer.text
        assert (answer.json()["code"], "memory" in answer.json()["detail"]) == ("too_much_memory", True)
        assert client.get("/v1/sessions").json()["items"] == []
        assert send(client, recording(seed=89)).status_code == 201


def test_a_session_that_ends_the_service_each_time_is_not_tried_for_ever(tmp_path, database, recording):
    url = database()
    with serving(settings_for(tmp_path / "data", url, workers=0)) as server:
        key = operations.add_key(server.service, "north", Role.CLINICIAN).key
        with server.client(key) as client:
            session = send(client, recording(seed=80)).json()["session"]
        for _ in range(2):  # as a server that is killed in the middle leaves it
            with server.service.store.write() as connection:
                sessions.begin_try(connection, session, 60.0)
    settings = settings_for(tmp_path / "data", url, workers=1, score_attempts=2)
    with serving(settings) as server, server.client(key) as client:
        time.sleep(2.5)  # two rounds of the background
        kept = client.get(f"/v1/sessions/{session}").json()
        assert (kept["state"], "ended each time" in kept["problem"]["detail"]) == ("unscored", True)
        assert client.post(f"/v1/sessions/{session}/reports").status_code == 201


def test_headers_without_end_are_cut_off(server):
    with socket.create_connection(("127.0.0.1", httpx.URL(server.url).port), timeout=20) as connection:
        connection.sendall(b"GET /livez HTTP/1.1\r\nHost: here\r\nX-Long: ")
        with contextlib.suppress(ConnectionError):
            for _ in range(4096):
                connection.sendall(b"a" * 4096)
            pytest.fail("16 MiB of one header were taken")
    with server.client() as client:
        assert client.get("/livez").status_code == 200


@pytest.mark.parametrize("sent", [b"", b"GET /livez HTTP/1.1\r\nHost: here\r\n"])
def test_a_request_that_never_begins_is_given_up(server, monkeypatch, sent):
    monkeypatch.setattr(BoundedHttp, "head_deadline_s", 0.5)
    with socket.create_connection(("127.0.0.1", httpx.URL(server.url).port), timeout=20) as connection:
        connection.sendall(sent)
        assert connection.recv(1) == b""


def test_when_scoring_is_saturated_bytes_are_kept_and_scored_later(tmp_path, database, recording):
    with own_server(tmp_path, database, max_waiting=0) as (server, clinic):
        client = clinic.client("clinician")
        assert client.get("/version").status_code == 200
        (worker,) = server.service.pool.pids
        os.kill(worker, signal.SIGSTOP)
        answers = {}

        def upload(seed):
            answers[seed] = send(client, recording(seed=seed))

        threads = [threading.Thread(target=upload, args=(seed,)) for seed in (84, 85, 86)]
        for each in threads:
            each.start()
        wait_until(lambda: len(answers) >= 2)
        os.kill(worker, signal.SIGCONT)
        for each in threads:
            each.join()
        busy = [each for each in answers.values() if each.status_code == 503]
        assert sorted(each.status_code for each in answers.values()) == [201, 503, 503]
        for each in busy:
            assert int(each.headers["retry-after"]) >= 1
            wait_until(
                lambda each=each: client.get(f"/v1/sessions/{each.json()['session']}").json()["state"] == "scored"
            )


def test_without_workers_recordings_are_kept_and_the_next_server_scores_them(tmp_path, database, recording):
    url = database()
    with serving(settings_for(tmp_path / "data", url, workers=0)) as server:
        key = operations.add_key(server.service, "north", Role.CLINICIAN).key
        with server.client(key) as client:
            answer = send(client, recording(seed=85))
            assert answer.status_code == 503
            assert int(answer.headers["retry-after"]) >= 1
    with serving(settings_for(tmp_path / "data", url, workers=1)) as server, server.client(key) as client:
        wait_until(lambda: client.get(f"/v1/sessions/{answer.json()['session']}").json()["state"] == "scored")


# ------------------------------------------------------------------------------------------ uploads that go wrong


def head_of(key, *headers):
    lines = ["POST /v1/sessions?device=pmdi HTTP/1.1", "Host: x", f"Authorization: Bearer {key}", *headers, "", ""]
    return "\r\n".join(lines).encode()


def raw_request(server, head, body=b""):
    with socket.create_connection(("127.0.0.1", int(server.url.rpartition(":")[2])), timeout=10) as connection:
        connection.sendall(head + body)
        answer = b""
        with contextlib.suppress(TimeoutError, ConnectionError):
            while block := connection.recv(65536):
                answer += block
                if b"\r\n\r\n" in answer and b"}" in answer:
                    break
        return answer.decode()


def left_in(server):
    return list((server.settings.data_dir / "raw" / "incoming").iterdir())


def test_a_stalled_upload_is_ended_and_leaves_nothing(tmp_path, database):
    with own_server(tmp_path, database, upload_stall_s=0.5, workers=0) as (server, clinic):
        head = head_of(clinic.key("uploader"), "Content-Type: text/csv", "Content-Length: 100000")
        started_s = time.monotonic()
        answer = raw_request(server, head, b"sensor,time_s")
        assert answer.startswith("HTTP/1.1 408")
        assert time.monotonic() - started_s < 5
        assert left_in(server) == []


def test_a_broken_off_upload_leaves_nothing(tmp_path, database, recording):
    with own_server(tmp_path, database, workers=0) as (server, clinic):
        port = int(server.url.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
            connection.sendall(head_of(clinic.key("uploader"), "Content-Type: text/csv", "Content-Length: 900000"))
            connection.sendall(recording(seed=87)[:20_000])
            wait_until(lambda: left_in(server))
        wait_until(lambda: not left_in(server))
        assert clinic.client("clinician").get("/v1/sessions").json()["items"] == []


@pytest.mark.parametrize("is_announced", [True, False])
def test_too_large_an_upload_is_refused_announced_or_not(tmp_path, database, recording, is_announced):
    with own_server(tmp_path, database, max_upload_bytes=2048, workers=0) as (server, clinic):
        content = recording(seed=88)
        blocks = (content[n : n + 1000] for n in range(0, len(content), 1000))
        answer = send(clinic.client("clinician"), content if is_announced else blocks)
        assert answer.status_code == 413
        assert left_in(server) == []


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 3 MiB, where the machine lets one be mounted."""
    place = tmp_path / "small"
    place.mkdir()
    options = ["-t", "tmpfs", "-o", "size=3m", "tmpfs", str(place)]
    if subprocess.run(["mount", *options], check=False, capture_output=True).returncode != 0:
        pytest.skip("mounting a small tmpfs needs root: sudo .venv/bin/python -m pytest tests/service")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_on_a_full_disk_uploads_are_refused_and_readiness_says_so(small_disk, recording):
    with serving(settings_for(small_disk, None, workers=1)) as server, contextlib.closing(server.clinic()) as clinic:
        client = clinic.client("clinician")
        assert client.get("/readyz").status_code == 200
        assert send(client, recording(seed=89)).status_code == 201
        filler = small_disk / "filler"
        with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        answer = send(client, recording(seed=90))
        assert answer.status_code == 507
        assert answer.headers["content-type"] == "application/problem+json"
        assert client.get("/readyz").status_code in {503, 507}  # SQLite may call it an input/output error
        assert client.get("/livez").status_code == 200
        assert left_in(server) == []
        filler.unlink()
        assert client.get("/readyz").status_code == 200
        assert send(client, recording(seed=90)).status_code == 201


def test_below_the_reserve_nothing_more_is_taken(tmp_path, database, recording):
    with own_server(tmp_path, database, workers=0) as (server, clinic):
        object.__setattr__(server.service.files, "_min_free_bytes", 2**62)
        assert send(clinic.client("clinician"), recording(seed=91)).status_code == 507
        assert clinic.client("clinician").get("/readyz").status_code == 507


# ------------------------------------------------------------------------------------------ the power goes


class Process:
    """The service as an operator starts it."""

    def __init__(self, data_dir: Path, url: str | None):
        environment = os.environ | {
            "INHALEMON_DATA_DIR": str(data_dir),
            "INHALEMON_WORKERS": "1",
            "INHALEMON_MIN_FREE_BYTES": "0",
            **({} if url is None else {"INHALEMON_DATABASE_URL": url}),
        }
        self.environment = environment
        self.child = subprocess.Popen(
            [sys.executable, "-m", "api", "serve", "--port", "0"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.child.stdout is not None
        self.url = re.search(r"http://[\d.]+:\d+", self.child.stdout.readline())[0]
        self.client = httpx.Client(base_url=self.url, timeout=30, trust_env=False)
        wait_until(self._is_ready)

    def _is_ready(self):
        with contextlib.suppress(httpx.TransportError):
            return self.client.get("/readyz").status_code == 200
        return False

    def key(self, role="clinician"):
        command = [sys.executable, "-m", "api", "add-key", "--clinic", "north", "--role", role]
        told = subprocess.run(command, env=self.environment, check=True, capture_output=True, text=True)
        return told.stdout.splitlines()[-1]

    def kill(self):
        self.client.close()
        self.child.kill()
        self.child.wait()
        self.child.stdout.close()


@pytest.mark.slow
def test_after_the_power_goes_all_that_was_acknowledged_is_there_and_gets_scored(tmp_path, database, recording):
    """Killed in the middle of uploads and started again: nothing acknowledged is lost, nothing is left over."""
    data_dir, url = tmp_path / "data", database()
    acknowledged: dict[str, str] = {}
    first = Process(data_dir, url)
    try:
        key = {"authorization": f"Bearer {first.key()}"}
        seeds = iter(range(1000))
        stop = threading.Event()

        def upload():
            with httpx.Client(base_url=first.url, headers=key, timeout=10, trust_env=False) as client:
                while not stop.is_set():
                    content = recording(seed=92) + b"\n" * next(seeds)  # other bytes, the same session
                    with contextlib.suppress(httpx.TransportError):
                        answer = send(client, content)
                        if answer.status_code == 201:
                            acknowledged[answer.json()["id"]] = hashlib.sha256(content).hexdigest()

        threads = [threading.Thread(target=upload) for _ in range(3)]
        for each in threads:
            each.start()
        wait_until(lambda: len(acknowledged) >= 5)
        workers = _children(first.child.pid)
        first.kill()
        stop.set()
        for each in threads:
            each.join()
        wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))  # workers leave by themselves
    finally:
        if first.child.poll() is None:
            first.kill()
    second = Process(data_dir, url)
    try:
        second.client.headers.update(key)
        for session, digest in acknowledged.items():
            content = second.client.get(f"/v1/sessions/{session}/recording").content
            assert hashlib.sha256(content).hexdigest() == digest
        listed = second.client.get("/v1/sessions", params={"limit": 200}).json()["items"]
        assert len(listed) >= len(acknowledged)
        wait_until(lambda: not second.client.get("/v1/sessions", params={"state": "unscored"}).json()["items"])
        assert list((data_dir / "raw" / "incoming").iterdir()) == []
    finally:
        second.kill()


def _children(pid):
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.slow
def test_two_servers_do_not_share_a_data_folder(tmp_path):
    first = Process(tmp_path / "data", None)
    try:
        again = subprocess.run(
            [sys.executable, "-m", "api", "serve", "--port", "0"],
            env=first.environment,
            check=False,
            capture_output=True,
            text=True,
        )
        assert again.returncode == 4
        assert "in use by another server" in again.stderr
    finally:
        first.kill()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("INHALEMON_PORT", "eighty", "INHALEMON_PORT"),
        ("INHALEMON_DATABASE_URL", "mysql://x", "sqlite:///PATH"),
        ("INHALEMON_SECRET", "short", "at least 32"),
        ("INHALEMON_OIDC_ISSUER", "https://login.example", "together"),
    ],
)
def test_wrong_settings_are_told_before_anything_starts(tmp_path, name, value, told):
    environment = os.environ | {"INHALEMON_DATA_DIR": str(tmp_path / "data"), name: value}
    command = [sys.executable, "-m", "api", "serve"]
    found = subprocess.run(command, env=environment, check=False, capture_output=True, text=True, timeout=30)
    assert found.returncode == 4
    assert told in found.stderr
    assert "Traceback" not in found.stderr
    if name == "INHALEMON_SECRET":
        assert value not in found.stderr, "a secret is not repeated"
