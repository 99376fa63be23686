"""Sessions: found, drawn, corrected, exported, erased."""

from __future__ import annotations

import csv
import io
import json
import struct

import numpy as np
import pytest
from sqlalchemy import update

from api import series
from api.channels import CHANNELS
from api.moments import DAY_US
from api.store import tables


def test_pages_hold_every_session_once_in_order(clinic, upload):
    for n, seed in enumerate(range(60, 67)):
        upload(clinic, seed=seed, recorded_at=f"2025-10-{10 + n // 2}T10:00:00Z")  # equal moments too
    client = clinic.client("clinician")
    for order, key, is_falling in (
        ("-recorded", "recorded_at", True),
        ("recorded", "recorded_at", False),
        ("-uploaded", "uploaded_at", True),
        ("uploaded", "uploaded_at", False),
    ):
        seen, cursor = [], None
        while True:
            params = {"order": order, "limit": 3, **({"cursor": cursor} if cursor else {})}
            page = client.get("/v1/sessions", params=params).json()
            seen += page["items"]
            cursor = page["next"]
            if cursor is None:
                break
        assert len({each["id"] for each in seen}) == len(seen) == 7
        moments = [each[key] for each in seen]
        assert moments == sorted(moments, reverse=is_falling)


def test_a_cursor_is_good_for_its_own_listing_only(clinic, other_clinic, upload):
    for seed in (68, 69, 70):
        upload(clinic, seed=seed)
    client = clinic.client("clinician")
    cursor = client.get("/v1/sessions", params={"limit": 1}).json()["next"]
    assert client.get("/v1/sessions", params={"limit": 1, "cursor": cursor}).status_code == 200
    for params in (
        {"cursor": cursor, "order": "recorded"},
        {"cursor": cursor + "A"},
        {"cursor": "%%%"},
        {"cursor": "é"},
    ):
        assert client.get("/v1/sessions", params=params).status_code == 400
    assert other_clinic.client("clinician").get("/v1/sessions", params={"cursor": cursor}).status_code == 400


def test_a_list_is_narrowed_by_everything_it_says(clinic, upload):
    pmdi = upload(clinic, seed=71, patient_ref="P-1", recorded_at="2025-01-02T00:00:00Z")
    ellipta = upload(clinic, seed=72, device="ellipta", patient_ref="P-2", recorded_at="2025-02-02T00:00:00Z")
    never = next(f["rule"] for f in ellipta["report"]["findings"] if f["rule"] == "vents_blocked")

    def ids(**params):
        answer = clinic.client("clinician").get("/v1/sessions", params=params)
        assert answer.status_code == 200, answer.text
        return {each["id"] for each in answer.json()["items"]}

    assert ids(patient="P-1") == {pmdi["id"]}
    assert ids(device="ellipta") == {ellipta["id"]}
    assert ids(grade=pmdi["grade"]) >= {pmdi["id"]}
    assert ids(rule=never, verdict="not_assessable") == {ellipta["id"]}
    assert ids(rule=never, verdict="fail") == set()
    assert ids(since="2025-02-01T00:00:00Z") == {ellipta["id"]}
    assert ids(until="2025-02-01") == {pmdi["id"]}
    assert ids(state="unscored") == set()


# ------------------------------------------------------------------------------------------ curves


@pytest.fixture
def session(clinic, upload):
    return upload(clinic, seed=73)


def test_curves_come_as_json_and_as_the_same_numbers_in_binary(clinic, session):
    client = clinic.client("clinician")
    url = f"/v1/sessions/{session['id']}/series"
    params = {"channels": "tilt_deg,angle_deg", "max_points": 400}
    told = client.get(url, params=params).json()
    assert told["channels"] == ["tilt_deg", "angle_deg"]
    assert 100 < len(told["time_s"]) <= 400
    packed = client.get(url, params=params, headers={"accept": series.BINARY_TYPE})
    assert packed.headers["content-type"] == series.BINARY_TYPE
    (length,) = struct.unpack_from("<I", packed.content)
    head = json.loads(packed.content[4 : 4 + length])
    rows = np.frombuffer(packed.content, "<f4", offset=4 + length).reshape(3, head["points"])
    assert np.allclose(rows, [told["time_s"], *(told["values"][name] for name in head["channels"])], atol=1e-6)
    part = client.get(url, params={**params, "from_s": 2.0, "to_s": 4.0}).json()
    assert 2.0 <= min(part["time_s"]) <= max(part["time_s"]) <= 4.0
    assert max(part["values"]["tilt_deg"]) <= 180.0


def test_an_unknown_channel_is_named(clinic, session):
    answer = clinic.client("clinician").get(
        f"/v1/sessions/{session['id']}/series", params={"channels": "tilt_deg,nope"}
    )
    assert answer.status_code == 422
    assert "nope" in answer.json()["detail"]


def test_reducing_keeps_every_spike_and_invents_none():
    n = 10_000
    table = np.zeros((len(CHANNELS), n), dtype=np.float32)
    table[0] = np.arange(n) / 100.0
    table[1] = np.sin(table[0])
    table[1, 5003], table[1, 7777] = 40.0, -40.0
    found = series.reduced(table, ["tilt_deg"], from_s=None, to_s=None, max_points=200)
    assert found.shape == (2, 200)
    assert (found[1].max(), found[1].min()) == (40.0, -40.0)
    assert set(found[1]) <= set(table[1])
    assert (np.diff(found[0]) >= 0).all()
    assert abs(found[0][found[1].argmax()] - 50.03) <= n / 100 / 100
    whole = series.reduced(table, ["tilt_deg"], from_s=10.0, to_s=10.5, max_points=200)
    assert np.array_equal(whole, table[:2, 1000:1051])


def test_the_page_of_a_session_can_reach_nothing(clinic, session):
    page = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/report.html")
    assert page.status_code == 200
    assert page.text.lstrip().lower().startswith("<!doctype html>")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "sandbox" in policy
    assert "allow-same-origin" not in policy


# ------------------------------------------------------------------------------------------ correcting, erasing


def test_scoring_again_with_the_same_pipeline_makes_no_new_version(clinic, session):
    client = clinic.client("clinician")
    again = client.post(f"/v1/sessions/{session['id']}/reports")
    assert again.status_code == 201
    assert again.json() == session["report"], "the same bytes give the same report, to the bit"
    assert len(client.get(f"/v1/sessions/{session['id']}/reports").json()) == 1
    assert client.get(f"/v1/sessions/{session['id']}/report", params={"version": 2}).status_code == 404


def test_a_wrong_patient_is_corrected_and_neither_name_is_in_the_audit(clinic, upload):
    session = upload(clinic, seed=74, patient_ref="P-111")
    client = clinic.client("clinician")
    answer = client.patch(f"/v1/sessions/{session['id']}", json={"patient_ref": "P-222"})
    assert answer.json()["patient_ref"] == "P-222"
    assert client.post(f"/v1/sessions/{session['id']}/reports").status_code == 201
    assert client.get(f"/v1/sessions/{session['id']}").json()["patient_ref"] == "P-222"
    assert client.patch(f"/v1/sessions/{session['id']}", json={"patient_ref": "Jane Doe"}).status_code == 422
    audit = clinic.client("administrator").get("/v1/audit", params={"limit": 200}).text
    assert "session.patient_corrected" in audit
    assert "P-111" not in audit
    assert "P-222" not in audit


def test_erasing_leaves_an_audit_entry_and_nothing_else(clinic, upload):
    session = upload(clinic, seed=75, patient_ref="P-333")
    client, boss = clinic.client("clinician"), clinic.client("administrator")
    client.get(f"/v1/sessions/{session['id']}/series")
    client.post(f"/v1/sessions/{session['id']}/reviews", json={"kind": "comment", "reason": "P-333 had a cold"})
    assert boss.delete(f"/v1/sessions/{session['id']}").status_code == 204
    assert client.get(f"/v1/sessions/{session['id']}").status_code == 404
    folder = clinic.server.settings.data_dir
    assert [each for each in folder.rglob("*") if session["sha256"] in each.name or session["id"] in each.name] == []
    audit = boss.get("/v1/audit", params={"limit": 200}).text
    assert "session.erased" in audit
    assert "P-333" not in audit
    assert boss.get("/v1/audit/verify").json()[0]["faults"] == []
    assert upload(clinic, seed=75)["id"] != session["id"], "the same bytes can be sent anew"


def test_the_export_holds_every_session_in_both_forms(clinic, upload):
    made = [upload(clinic, seed=seed, patient_ref="P-5") for seed in (76, 77)]
    client = clinic.client("clinician")
    rows = list(csv.DictReader(io.StringIO(client.get("/v1/export").text)))
    assert {each["id"] for each in rows} == {each["id"] for each in made}
    assert rows[0]["patient_ref"] == "P-5"
    for rule in (f["rule"] for f in made[0]["report"]["findings"]):
        assert rule in rows[0]
    lines = [json.loads(line) for line in client.get("/v1/export", params={"format": "jsonl"}).text.splitlines()]
    assert [each["report"] for each in lines] == [
        each["report"] for each in sorted(made, key=lambda x: x["uploaded_at"])
    ]


def test_a_patient_is_in_no_log(clinic, upload, capfd):
    upload(clinic, seed=78, patient_ref="P-7731-99")
    clinic.client("clinician").get("/v1/patients/P-7731-99/progress")
    clinic.client("clinician").get("/v1/sessions", params={"patient": "P-7731-99"})
    told = "".join(capfd.readouterr())
    assert "/v1/patients/{ref}/progress" in told, "there is a log"
    assert "7731-99" not in told


@pytest.mark.parametrize("moment", ["0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-12:00", "1970-01-01"])
def test_any_moment_can_be_asked_for(clinic, upload, moment):
    upload(clinic, seed=79)
    for name in ("since", "until"):
        assert clinic.client("clinician").get("/v1/sessions", params={name: moment}).status_code == 200


def test_a_stored_moment_beyond_the_calendar_can_be_read(clinic, upload):
    """Such as one that an earlier version took."""
    session = upload(clinic, seed=79)["id"]
    beyond_us = 4_000_000 * DAY_US
    with clinic.server.service.store.write() as connection:
        changes = {"recorded_at_us": beyond_us, "happened_at_us": beyond_us}
        connection.execute(update(tables.sessions).where(tables.sessions.c.id == session).values(changes))
    client = clinic.client("clinician")
    for path in (
        "/v1/sessions",
        f"/v1/sessions/{session}",
        "/v1/review-queue",
        "/v1/export",
        f"/v1/sessions/{session}/fhir",
    ):
        answer = client.get(path)
        assert answer.status_code == 200, path
        assert "9999-12-31" in answer.text
