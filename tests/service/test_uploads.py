"""Recordings come in: stored first, then scored, each once."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import time
from dataclasses import replace

import pytest
from running import serving, settings_for
from sqlalchemy import text

import inhalemon as im
from api import operations
from api.principal import Role
from api.store import chores, people
from inhalemon.recording import write_recording

CSV = {"content-type": "text/csv"}


def send(clinic, content, *, role="clinician", headers=None, **params):
    return clinic.client(role).post(
        "/v1/sessions", content=content, params={"device": "pmdi", **params}, headers={**CSV, **(headers or {})}
    )


def test_an_upload_is_answered_with_place_and_report(clinic, recording):
    answer = send(clinic, recording(seed=1), patient_ref="P-0042", recorded_at="2025-11-20T08:30:00+09:00")
    assert answer.status_code == 201, answer.text
    told = answer.json()
    assert answer.headers["location"] == f"/v1/sessions/{told['id']}"
    assert told["state"] == "scored"
    assert told["patient_ref"] == "P-0042"
    assert told["recorded_at"].startswith("2025-11-19T23:30:00")
    assert told["report"]["format"] == "inhalemon-report/1"
    assert told["report"]["device"] == "pmdi"
    assert clinic.client("clinician").get(answer.headers["location"]).json()["report"] == told["report"]


def test_the_same_bytes_again_are_the_same_session_and_scored_once(clinic, other_clinic, recording):
    first, again = (send(clinic, recording(seed=2)) for _ in range(2))
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json()["id"] == first.json()["id"]
    assert again.json()["report"] == first.json()["report"]
    versions = clinic.client("clinician").get(f"{first.headers['location']}/reports").json()
    assert [each["version"] for each in versions] == [1]
    elsewhere = send(other_clinic, recording(seed=2))
    assert elsewhere.status_code == 201, "another clinic's bytes are its own"
    assert elsewhere.json()["id"] != first.json()["id"]


def test_a_form_brings_recording_and_metadata(clinic, recording):
    metadata = {"device": "ellipta", "session_id": "morning", "patient_ref": "P-7"}
    answer = clinic.client("uploader").post(
        "/v1/sessions",
        files={
            "recording": ("x.csv", recording("ellipta", seed=3), "text/csv"),
            "metadata": (None, json.dumps(metadata), "application/json"),
        },
    )
    assert answer.status_code == 201, answer.text
    assert answer.json()["session_id"] == "morning"
    assert answer.json()["report"]["session_id"] == "morning"
    assert answer.json()["device"] == "ellipta"


def test_several_files_are_answered_item_by_item(clinic, recording):
    files = [
        ("recording", ("a.csv", recording(seed=4), "text/csv")),
        ("recording", ("b.csv", b"sensor,time_s\nbody,0\n", "text/csv")),
        ("recording", ("c.csv.gz", gzip.compress(recording(seed=5)), "application/gzip")),
    ]
    answer = clinic.client("clinician").post("/v1/sessions", files=files, params={"device": "pmdi"})
    assert answer.status_code == 207, answer.text
    items = answer.json()["items"]
    assert [(each["file"], each["status"]) for each in items] == [("a.csv", 201), ("b.csv", 422), ("c.csv.gz", 201)]
    assert items[1]["problem"]["line"] == 1
    assert len(clinic.client("clinician").get("/v1/sessions").json()["items"]) == 2


def test_an_unusable_recording_is_refused_with_line_and_column_and_not_kept(clinic, recording):
    lines = recording(seed=6).decode().splitlines()
    cells = lines[100].split(",")
    cells[5] = "nan"
    lines[100] = ",".join(cells)
    answer = send(clinic, "\n".join(lines).encode(), file_name="taken.csv")
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    told = answer.json()
    assert (told["line"], told["column"]) == (101, lines[0].split(",")[5])
    assert clinic.client("clinician").get("/v1/sessions").json()["items"] == []
    assert list((clinic.server.settings.data_dir / "raw" / clinic.id).rglob("*.zst")) == []


def test_the_bytes_come_back_as_they_went(clinic, recording):
    content = gzip.compress(recording(seed=7))
    place = send(clinic, content, headers={"content-type": "application/gzip"}).headers["location"]
    answer = clinic.client("clinician").get(f"{place}/recording")
    assert answer.content == content
    digest = base64.b64encode(hashlib.sha256(content).digest()).decode()
    assert answer.headers["repr-digest"] == f"sha-256=:{digest}:"


@pytest.mark.parametrize(("is_right", "status"), [(True, 201), (False, 400)])
def test_bytes_that_differ_from_their_digest_are_refused(clinic, recording, is_right, status):
    content = recording(seed=8)
    digest = hashlib.sha256(content if is_right else b"other").digest()
    answer = send(clinic, content, headers={"repr-digest": f"sha-256=:{base64.b64encode(digest).decode()}:"})
    assert answer.status_code == status


def test_a_key_for_once_repeats_the_first_answer(clinic, recording):
    headers = {"idempotency-key": "upload-1"}
    first, again = (send(clinic, recording(seed=9), headers=headers) for _ in range(2))
    assert (first.status_code, again.status_code) == (201, 201)
    assert again.json() == first.json()
    other = send(clinic, recording(seed=10), headers=headers)
    assert (other.status_code, other.json()["code"]) == (422, "idempotency_key_reused")


def test_a_key_for_once_whose_request_died_with_the_server_can_be_sent_again(tmp_path, database, recording):
    url = database()
    with serving(settings_for(tmp_path / "data", url, workers=0)) as server:
        key = operations.add_key(server.service, "north", Role.CLINICIAN).key
        with server.service.store.write() as connection:  # as a request leaves it that is under way at a power cut
            holder = people.key_with_prefix(connection, key.split("_")[1]).id
            assert chores.claim_key(connection, holder, "upload-1", "POST /v1/sessions x") is None
    with serving(settings_for(tmp_path / "data", url, workers=1)) as server, server.client(key) as client:
        headers = CSV | {"idempotency-key": "upload-1"}
        answer = client.post("/v1/sessions?device=pmdi", content=recording(seed=9), headers=headers)
        assert answer.status_code == 201, answer.text


def test_a_key_for_once_covers_several_files_until_one_of_them_is_erased(clinic, recording):
    def send_three():
        files = [
            ("recording", ("a.csv", recording(seed=40), "text/csv")),
            ("recording", ("b.csv", b"sensor,time_s\nbody,0\n", "text/csv")),
            ("recording", ("c.csv", recording(seed=41), "text/csv")),
        ]
        headers = {"idempotency-key": "upload-of-three"}
        return clinic.client("administrator").post(
            "/v1/sessions", files=files, params={"device": "pmdi"}, headers=headers
        )

    first, again = send_three(), send_three()
    assert [each["status"] for each in first.json()["items"]] == [201, 422, 201]
    assert (again.status_code, again.json()) == (207, first.json())
    assert again.headers["idempotency-replayed"] == "true"
    erased = first.json()["items"][2]["location"]
    assert clinic.client("administrator").delete(erased).status_code == 204
    afresh = send_three()
    assert "idempotency-replayed" not in afresh.headers
    assert [each["status"] for each in afresh.json()["items"]] == [200, 422, 201]


@pytest.mark.parametrize(
    ("headers", "content", "status"),
    [
        ({"content-type": "image/png"}, b"x", 415),
        ({"content-type": "application/json"}, b"{}", 415),
        ({"content-type": "text/csv", "content-encoding": "br"}, b"x", 415),
        ({"content-type": "text/csv"}, b"", 422),
        ({"content-type": "multipart/form-data"}, b"x", 400),
        ({"content-type": "multipart/form-data; boundary=x"}, b"--x\r\n", 400),
        ({"content-type": "multipart/form-data; boundary=x"}, b"--x--\r\n", 422),
    ],
)
def test_what_is_no_recording_is_refused(clinic, headers, content, status):
    answer = clinic.client("clinician").post(
        "/v1/sessions", content=content, headers=headers, params={"device": "pmdi"}
    )
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("ref", ["John Smith", "山田太郎", "Tanaka Hanako 1970-01-01", "smith42"])
def test_what_tells_who_it_is_is_refused_and_not_repeated(clinic, recording, ref):
    answer = send(clinic, recording(seed=11), patient_ref=ref)
    assert answer.status_code == 422
    assert (answer.json()["code"], answer.json()["column"]) == ("patient_ref_not_pseudonymous", "patient_ref")
    assert ref not in answer.text
    assert clinic.client("clinician").get("/v1/sessions").json()["items"] == []


def test_metadata_that_is_not_known_is_not_kept(clinic, recording):
    metadata = {"device": "pmdi", "patient_name": "Tanaka Hanako", "birth_date": "1970-01-01"}
    answer = clinic.client("uploader").post(
        "/v1/sessions",
        files={
            "recording": ("x.csv", recording(seed=11), "text/csv"),
            "metadata": (None, json.dumps(metadata), "application/json"),
        },
    )
    assert answer.status_code == 201
    with clinic.server.service.store.read() as connection:
        query = text("SELECT sidecar FROM sessions WHERE id = :id").bindparams(id=answer.json()["id"])
        sidecar = connection.execute(query).scalar_one()
    assert json.loads(sidecar) == {"device": "pmdi"}


@pytest.mark.parametrize("session_id", ["morning", "2025-11-20 08:30 (1)", "tokyo-late-press"])
def test_a_recordings_own_name_is_taken_as_it_is(clinic, recording, session_id):
    assert send(clinic, recording(seed=11), session_id=session_id).status_code == 201


@pytest.mark.parametrize("ref", ["P/0042", "..", ".", "a\\b"])
def test_a_patient_ref_that_breaks_an_address_is_refused(clinic, recording, ref):
    assert send(clinic, recording(seed=11), patient_ref=ref).status_code == 422


@pytest.mark.parametrize(
    "recorded_at",
    [
        "9999-12-31T23:59:59-12:00",
        "0001-01-01T00:00:00+14:00",
        "2999-01-01T00:00:00Z",
        "1989-12-31T23:59:59Z",
        "2100-01-01T00:00:00Z",
        "20",
    ],
)
def test_a_time_at_which_nothing_was_recorded_is_refused_and_nothing_kept(clinic, recording, recorded_at):
    answer = send(clinic, recording(seed=13), recorded_at=recorded_at)
    assert (answer.status_code, answer.json()["column"]) == (422, "recorded_at")
    listed = clinic.client("clinician").get("/v1/sessions")
    assert (listed.status_code, listed.json()["items"]) == (200, [])


def test_a_clock_that_is_ahead_is_believed(clinic, recording):
    """Whose clock is wrong, the device's or the server's, nobody here knows."""
    assert send(clinic, recording(seed=13), recorded_at="2099-12-31T12:00:00Z").status_code == 201


@pytest.mark.parametrize(
    "odd",
    [{"recorded_at": "2999-01-01T00:00:00+00:00"}, {"patient_ref": "John Smith"}],
)
def test_what_the_file_itself_tells_is_checked_as_well_and_the_file_not_kept(clinic, tmp_path, odd):
    recording, _ = im.simulate_session("pmdi", seed=1, rate_hz=50.0)
    write_recording(replace(recording, **odd), tmp_path / "x.parquet")
    headers = {"content-type": "application/vnd.apache.parquet"}
    content = (tmp_path / "x.parquet").read_bytes()
    answer = clinic.client("clinician").post("/v1/sessions", content=content, headers=headers)
    assert answer.status_code == 422, answer.text
    assert answer.json().get("column") == next(iter(odd)), answer.text
    assert clinic.client("clinician").get("/v1/sessions").json()["items"] == []
    assert list((clinic.server.settings.data_dir / "raw" / clinic.id).rglob("*.zst")) == []


# ------------------------------------------------------------------------------------------ known bytes, other metadata


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"patient_ref": "P-2"}, ["patient_ref"]),
        ({"device": "ellipta"}, ["device"]),
        ({"recorded_at": "2026-11-21T08:30:00Z", "device": "ellipta"}, ["device", "recorded_at"]),
        ({"session_id": "S-2"}, ["session_id"]),
    ],
)
def test_known_bytes_with_other_metadata_are_told_so_and_nothing_changes(clinic, recording, other, named):
    """Dropped in silence, a wrong patient or device would never come to light."""
    given = {"device": "pmdi", "patient_ref": "P-1", "recorded_at": "2026-11-20T08:30:00Z"}
    client, headers = clinic.client("uploader"), {"content-type": "text/csv"}

    def upload(metadata):
        return client.post("/v1/sessions", content=recording(seed=9), params=metadata, headers=headers)

    first = upload(given)
    assert first.status_code == 201
    again = upload(given | other)
    assert (again.status_code, again.json()) == (200, first.json())
    assert again.headers["inhalemon-differing"].split(", ") == named
    kept = clinic.client("clinician").get(first.headers["location"]).json()
    assert {name: kept[name] for name in ("device", "patient_ref")} == {"device": "pmdi", "patient_ref": "P-1"}
    for same in (given, {"device": "pmdi"}, {}):
        assert "inhalemon-differing" not in upload(same).headers, "what is left out is not contradicted"


def test_a_recording_kept_without_its_device_is_scored_once_the_device_comes(tmp_path, database, recording):
    url, headers = database(), {"content-type": "text/csv"}

    def upload(client, **metadata):
        return client.post("/v1/sessions", content=recording(seed=10), params=metadata, headers=headers)

    with serving(settings_for(tmp_path / "data", url, workers=0)) as server:
        key = operations.add_key(server.service, "north", Role.CLINICIAN).key
        with server.client(key) as client:
            session = upload(client).json()["session"]
            assert upload(client, patient_ref="P-1").json()["session"] == session
    with serving(settings_for(tmp_path / "data", url, workers=1)) as server, server.client(key) as client:

        def state():
            return client.get(f"/v1/sessions/{session}").json()["state"]

        deadline_s = time.monotonic() + 20
        while state() != "unusable" and time.monotonic() < deadline_s:
            time.sleep(0.05)
        assert state() == "unusable"
        answer = upload(client, device="pmdi", patient_ref="P-2")
        assert (answer.status_code, answer.json()["id"]) == (200, session)
        assert {name: answer.json()[name] for name in ("state", "device", "patient_ref")} == {
            "state": "scored",
            "device": "pmdi",
            "patient_ref": "P-2",
        }


def test_a_wrong_device_is_corrected_and_the_session_scored_again(clinic, recording, upload):
    session = upload(clinic, seed=11, device="ellipta")
    path, client = f"/v1/sessions/{session['id']}", clinic.client("clinician")
    wrong = upload(clinic, seed=12, device="pmdi")
    answer = client.patch(f"/v1/sessions/{wrong['id']}", json={"device": "ellipta", "patient_ref": "P-5"})
    assert answer.status_code == 200, answer.text
    assert {name: answer.json()[name] for name in ("device", "patient_ref")} == {
        "device": "ellipta",
        "patient_ref": "P-5",
    }
    told = client.get(f"/v1/sessions/{wrong['id']}").json()
    assert told["report"]["device"] == "ellipta"
    assert [each["version"] for each in client.get(f"/v1/sessions/{wrong['id']}/reports").json()] == [1, 2]
    assert client.post(f"/v1/sessions/{wrong['id']}/reports").status_code == 201
    assert client.get(f"/v1/sessions/{wrong['id']}").json()["device"] == "ellipta", "and it stays so"
    assert client.patch(path, json={"device": "pmdi"}).status_code == 200
    assert client.get(f"{path}/report").json()["device"] == "pmdi"
    for nonsense in ({}, {"device": None}, {"device": "spoon"}):
        assert client.patch(path, json=nonsense).status_code == 422
    assert "session.device_corrected" in clinic.client("administrator").get("/v1/audit", params={"limit": 200}).text


def test_a_worker_reads_one_parquet_file_after_another(clinic, tmp_path):
    """Its end to memory must not count what the reader only reserves."""
    for seed in range(4):
        recording, _ = im.simulate_session("pmdi", seed=seed, rate_hz=50.0)
        write_recording(recording, tmp_path / f"{seed}.parquet")
        headers = {"content-type": "application/vnd.apache.parquet"}
        content = (tmp_path / f"{seed}.parquet").read_bytes()
        answer = clinic.client("clinician").post("/v1/sessions", content=content, headers=headers)
        assert answer.status_code == 201, answer.text
