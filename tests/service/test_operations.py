"""What an operator does by hand, as the operator does it: `python -m api`."""

from __future__ import annotations

import contextlib
import itertools
import os
import sqlite3
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path

import httpx
import pytest
from running import serving, settings_for

from api import auth, operations, upkeep
from api.principal import Role

CSV = {"content-type": "text/csv"}


def run(data_dir: Path, *arguments: str, url: str | None = None, given: str | None = None):
    environment = os.environ | {"INHALEMON_DATA_DIR": str(data_dir), "INHALEMON_MIN_FREE_BYTES": "1"}
    if url is not None:
        environment["INHALEMON_DATABASE_URL"] = url
    command = [sys.executable, "-m", "api", *arguments]
    return subprocess.run(
        command, env=environment, check=False, capture_output=True, text=True, input=given, timeout=60
    )


@pytest.fixture
def filled(tmp_path, database, recording):
    """A data folder with one session, and the key that uploaded it."""
    settings = settings_for(tmp_path / "data", database(), workers=1)
    with serving(settings) as server:
        key = operations.add_key(server.service, "north", Role.ADMINISTRATOR).key
        with server.client(key) as client:
            headers = {"content-type": "text/csv"}
            answer = client.post("/v1/sessions?device=pmdi", content=recording(seed=120), headers=headers)
            assert answer.status_code == 201
    return settings, key, answer.json()


def test_a_key_stands_alone_on_the_last_line_and_works(tmp_path, database):
    settings = settings_for(tmp_path / "data", database(), workers=0)
    made = run(settings.data_dir, "add-key", "--clinic", "north", "--role", "clinician", url=settings.database_url)
    assert made.returncode == 0, made.stderr
    key = made.stdout.splitlines()[-1]
    with serving(settings) as server:
        answer = httpx.get(f"{server.url}/v1/me", headers={"authorization": f"Bearer {key}"}, trust_env=False)
    assert answer.json()["clinics"] == ["north"]
    assert answer.json()["role"] == "clinician"


def test_nobody_else_can_look_into_a_new_data_folder(tmp_path):
    with operations.serving_alone(tmp_path / "data"):
        assert (tmp_path / "data").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("verb", ["serve", "doctor"])
def test_a_data_folder_that_cannot_be_made_is_told_in_one_line(tmp_path, verb):
    (tmp_path / "file").touch()
    found = run(tmp_path / "file" / "data", verb)
    assert found.returncode == 4
    assert str(tmp_path / "file") in found.stderr
    assert found.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_backup_is_restored_elsewhere_whole(tmp_path, database, filled, recording):
    settings, key, session = filled
    archive = tmp_path / "backup.tar"
    made = run(settings.data_dir, "backup", str(archive), url=settings.database_url)
    assert made.returncode == 0, made.stderr
    assert archive.stat().st_mode & 0o077 == 0
    elsewhere = settings_for(tmp_path / "elsewhere", database(), workers=1)
    back = run(elsewhere.data_dir, "restore", str(archive), url=elsewhere.database_url)
    assert back.returncode == 0, back.stderr
    with serving(elsewhere) as server, server.client(key) as client:
        assert client.get(f"/v1/sessions/{session['id']}").json()["report"] == session["report"]
        assert client.get(f"/v1/sessions/{session['id']}/recording").content == recording(seed=120)
        assert client.get("/v1/audit/verify").json()[0]["faults"] == []
    again = run(elsewhere.data_dir, "restore", str(archive), url=elsewhere.database_url)
    assert again.returncode == 4
    assert "not empty" in again.stderr


@pytest.mark.slow
def test_a_backup_made_under_load_is_restored_whole(tmp_path, database, recording):
    """What comes in while the archive is written is no part of it: neither its rows nor its files."""
    settings = settings_for(tmp_path / "data", database(), workers=0)
    with serving(settings) as server:
        key = operations.add_key(server.service, "north", Role.UPLOADER).key
        content, seeds, stop = recording(seed=121), itertools.count(1), threading.Event()

        def upload():
            with server.client(key) as client:
                while not stop.is_set():  # without workers: kept, and to be scored later
                    client.post("/v1/sessions", content=content + b"\n" * next(seeds), headers=CSV)

        threads = [threading.Thread(target=upload) for _ in range(2)]
        for each in threads:
            each.start()
        try:
            for n in range(2):
                made = run(settings.data_dir, "backup", str(tmp_path / f"{n}.tar"), url=settings.database_url)
                assert made.returncode == 0, made.stderr
        finally:
            stop.set()
            for each in threads:
                each.join()
    for n in range(2):
        elsewhere = settings_for(tmp_path / f"elsewhere{n}", database())
        back = run(elsewhere.data_dir, "restore", str(tmp_path / f"{n}.tar"), url=elsewhere.database_url)
        assert (back.returncode, back.stderr) == (0, ""), back.stderr[:500]


def test_a_restore_holds_no_whole_database_in_memory(tmp_path, filled):
    """The archive's database is padded to 200 MB: restoring it must not take as much."""
    settings, _, _ = filled
    if settings.database_url is not None:
        pytest.skip("pg_restore reads the copy, not this program")
    with contextlib.closing(sqlite3.connect(settings.data_dir / "inhalemon.sqlite3")) as connection:
        connection.execute("CREATE TABLE padding AS SELECT zeroblob(200000000) AS filling")
        connection.commit()
    archive = tmp_path / "backup.tar"
    assert run(settings.data_dir, "backup", str(archive)).returncode == 0
    tracemalloc.start()
    try:
        upkeep.restore(settings_for(tmp_path / "elsewhere", None), archive)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("verb", [["backup", "x.tar"], ["verify"], ["doctor"], ["users"], ["lock-user", "sato"]])
def test_what_only_looks_makes_no_data_folder(tmp_path, verb):
    """Without the unit's environment, `verify` once made an empty folder and found no faults in it."""
    found = run(tmp_path / "data", *verb)
    assert found.returncode == 4
    assert "no data folder" in found.stderr
    assert not (tmp_path / "data").exists()


def test_a_missing_database_is_not_made_anew_either(tmp_path):
    assert run(tmp_path / "data", "add-clinic", "north").returncode == 0
    (tmp_path / "data" / "inhalemon.sqlite3").unlink()
    found = run(tmp_path / "data", "verify")
    assert (found.returncode, "holds nothing" in found.stderr) == (4, True)
    assert not (tmp_path / "data" / "inhalemon.sqlite3").exists()


def test_one_database_serves_one_data_folder(tmp_path, database):
    url = database() or f"sqlite:///{tmp_path / 'shared.sqlite3'}"
    assert run(tmp_path / "one", "add-clinic", "north", url=url).returncode == 0
    for verb in (["serve", "--port", "0"], ["migrate"], ["add-clinic", "south"]):
        found = run(tmp_path / "other", *verb, url=url)
        assert found.returncode == 4
        assert "another data folder" in found.stderr
    assert run(tmp_path / "one", "add-clinic", "south", url=url).returncode == 0


@pytest.mark.parametrize("verb", ["serve", "doctor"])
@pytest.mark.parametrize("name", ["SCORING_RULES", "SCORING_SETTINGS"])
@pytest.mark.parametrize("content", [None, "nonsense = [", "[unknown]\nx = 1\n"])
def test_rules_and_settings_that_cannot_be_loaded_are_told_at_the_start(tmp_path, monkeypatch, verb, name, content):
    path = tmp_path / "given.toml"
    if content is not None:
        path.write_text(content)
    monkeypatch.setenv(f"INHALEMON_{name}", str(path))
    found = run(tmp_path / "data", verb)
    assert found.returncode == 4
    assert f"INHALEMON_{name}: " in found.stderr
    assert "given.toml" in found.stderr
    assert found.stderr.count("\n") == 1


@pytest.mark.slow
def test_the_operator_has_the_people_in_hand(tmp_path, database):
    settings = settings_for(tmp_path / "data", database(), workers=0)

    def told(*arguments, code=0):
        done = run(settings.data_dir, *arguments, url=settings.database_url)
        assert done.returncode == code, done.stderr
        return done.stderr if code else done.stdout

    for slug in ("north", "south", "west"):
        told("add-clinic", slug)
    clinics = ["--clinic", "north", "--clinic", "south", "--clinic", "north"]
    first = told("add-user", "Mori", "--role", "pharmacist", *clinics).splitlines()[-1]
    told("add-user", "sato", "--role", "clinician", "--clinic", "north", "--clinic", "north")
    assert "mori\tpharmacist\tnorth,south\tactive" in told("users")
    told("assign-clinic", "mori", "west")
    told("withdraw-clinic", "mori", "south")
    assert "mori\tpharmacist\tnorth,west\tactive" in told("users")
    told("lock-user", "mori")
    assert "mori\tpharmacist\tnorth,west\tlocked out" in told("users")
    told("unlock-user", "mori")
    second = told("reset-password", "mori").splitlines()[-1]
    with serving(settings) as server:
        assert auth.check_password(server.service.store, "mori", first) is None
        assert auth.check_password(server.service.store, "mori", second).must_change_password
    assert "nobody named" in told("lock-user", "nobody", code=1)
    assert "no clinic 'east'" in told("assign-clinic", "mori", "east", code=1)
    assert "Only a pharmacist" in told("assign-clinic", "sato", "west", code=1)
    assert "only clinic" in told("withdraw-clinic", "sato", "north", code=1)
    assert "No faults" in told("verify")


@pytest.mark.slow
@pytest.mark.parametrize("harm", ["change", "remove", "add"])
def test_verify_finds_a_recording_that_was_touched(filled, harm):
    settings, _, session = filled
    assert run(settings.data_dir, "verify", url=settings.database_url).returncode == 0
    (path,) = (settings.data_dir / "raw").rglob(f"{session['sha256']}.zst")
    if harm == "change":
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    elif harm == "remove":
        path.unlink()
    else:
        path.with_name(f"{'0' * 64}.zst").write_bytes(b"x")
    found = run(settings.data_dir, "verify", url=settings.database_url)
    assert found.returncode == 1
    assert ("0" * 64 if harm == "add" else session["sha256"]) in found.stdout


@pytest.mark.slow
def test_the_doctor_says_what_wants_attention(tmp_path):
    data_dir = tmp_path / "data"
    assert run(data_dir, "migrate").returncode == 0
    first = run(data_dir, "doctor")
    assert first.returncode == 1
    assert "LOOK   0 people can log in" in first.stdout
    added = run(data_dir, "add-user", "sato", "--role", "administrator", "--clinic", "north")
    assert added.returncode == 0, added.stderr
    assert run(data_dir, "doctor").returncode == 0
    data_dir.chmod(0o755)
    assert "readable by others" in run(data_dir, "doctor").stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "given", "code", "told"),
    [
        (["add-key", "--clinic", "North Clinic", "--role", "clinician"], None, 2, "lower-case"),
        (["add-key", "--clinic", "north", "--role", "king"], None, 2, "king"),
        (["add-key", "--clinic", "north", "--role", "uploader", "--scope", "admin"], None, 1, "admin"),
        (["add-user", "x1", "--role", "clinician", "--clinic", "a", "--clinic", "b"], None, 1, "pharmacist"),
        (["add-user", "x1", "--role", "clinician", "--clinic", "a", "--password-stdin"], "short\n", 1, "at least"),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_sentence(tmp_path, arguments, given, code, told):
    found = run(tmp_path / "data", *arguments, given=given)
    assert found.returncode == code
    assert told in found.stderr
    assert "Traceback" not in found.stderr
