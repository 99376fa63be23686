"""What an operator does by hand, as the operator does it: `python -m api`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
from running import serving, settings_for

from api import operations
from api.principal import Role


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
