"""A sign-off holds one report and the review as it was; the result of a session is that after review."""

from __future__ import annotations

import csv
import io
import json
import re

from running import serving, settings_for

from inhalemon.rules.scoring import POINTS
from inhalemon.values import Severity


def write(clinic, session, role="clinician", **entry):
    answer = clinic.client(role).post(f"/v1/sessions/{session['id']}/reviews", json=entry)
    assert answer.status_code == 201, answer.text
    return answer.json()


def read(clinic, session, path=""):
    answer = clinic.client("clinician").get(f"/v1/sessions/{session['id']}{path}")
    assert answer.status_code == 200, answer.text
    return answer.json()


def statuses(clinic, session):
    """What FHIR says of observation and report."""
    found = [each["resource"] for each in read(clinic, session, "/fhir")["entry"]]
    return {each["status"] for each in found if each["resourceType"] in {"Observation", "DiagnosticReport"}}


def queued(clinic):
    return [each["session"]["id"] for each in clinic.client("clinician").get("/v1/review-queue").json()["items"]]


def failed(session):
    return {each["rule"]: each["severity"] for each in session["report"]["findings"] if each["verdict"] == "fail"}


def test_a_new_report_opens_a_signed_session_again(tmp_path, recording):
    """What was signed are the findings of one report; those of another one nobody has seen."""
    with serving(settings_for(tmp_path, None, workers=1)) as server:
        clinic = server.clinic()
        answer = clinic.client("clinician").post(
            "/v1/sessions",
            content=recording(),
            params={"device": "pmdi"},
            headers={"content-type": "text/csv"},
        )
        session, slug = answer.json(), clinic.slug
        write(clinic, session, kind="sign_off")
        assert statuses(clinic, session) == {"final"}
        assert clinic.client("clinician").get("/v1/agreement").json()["machine_and_reviewers"]["sessions"] == 1
        clinic.close()
    with serving(settings_for(tmp_path, None, workers=1, scoring_rules="strict")) as server:
        clinic = type(clinic)(server, slug)
        page = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/report.html").text
        assert session["report"]["rules_digest"][:12] in page, "the page shows the report that is stored"
        assert "Signed off by" in page
        assert clinic.client("clinician").post(f"/v1/sessions/{session['id']}/reports").status_code == 201
        assert read(clinic, session)["signed_off_at"] is None
        history = read(clinic, session, "/reviews")
        assert history["signed_off_at"] is None
        assert history["entries"][0]["is_outdated"] is True
        assert queued(clinic) == [session["id"]]
        assert statuses(clinic, session) == {"preliminary"}
        told = clinic.client("clinician").get("/v1/agreement").json()["machine_and_reviewers"]
        assert told == {"sessions": 0, "rules": []}, "nobody has confirmed the new findings"
        write(clinic, session, kind="sign_off")
        assert read(clinic, session)["signed_off_at"] is not None
        assert statuses(clinic, session) == {"amended"}
        clinic.close()


def test_scoring_again_with_the_same_outcome_leaves_a_session_signed(clinic, upload):
    session = upload(clinic, seed=60)
    write(clinic, session, kind="sign_off")
    assert clinic.client("clinician").post(f"/v1/sessions/{session['id']}/reports").status_code == 201
    assert read(clinic, session)["signed_off_at"] is not None
    assert statuses(clinic, session) == {"final"}


def test_a_later_entry_of_anybody_opens_a_signed_session_again(clinic, upload):
    session = upload(clinic, seed=61)
    write(clinic, session, kind="sign_off")
    later = write(clinic, session, role="pharmacist", kind="comment", reason="there was a spacer")
    assert read(clinic, session)["signed_off_at"] is None
    assert queued(clinic) == [session["id"]]
    assert statuses(clinic, session) == {"preliminary"}
    write(clinic, session, role="pharmacist", kind="undo", undoes=later["id"])
    assert read(clinic, session)["signed_off_at"] is not None, "it is again what was signed"
    assert statuses(clinic, session) == {"final"}
    write(clinic, session, role="pharmacist", kind="comment", reason="there was a spacer")
    write(clinic, session, role="pharmacist", kind="sign_off")
    assert read(clinic, session)["signed_off_at"] is not None
    assert statuses(clinic, session) == {"amended"}


def test_two_people_sign_the_same_and_agree_with_each_other(clinic, upload):
    session = upload(clinic, seed=62)
    write(clinic, session, kind="sign_off")
    write(clinic, session, role="pharmacist", kind="sign_off")
    assert read(clinic, session)["signed_off_at"] is not None
    assert statuses(clinic, session) == {"final"}
    told = clinic.client("clinician").get("/v1/agreement").json()["reviewers_among_each_other"]
    assert told["sessions"] == 1
    assert all(row["only_first_fails"] == row["only_second_fails"] == 0 for row in told["rules"])


def test_who_signs_after_somebodys_override_signs_the_override(clinic, upload):
    session = upload(clinic, seed=63)
    rule = next(each["rule"] for each in session["report"]["findings"] if each["verdict"] == "pass")
    write(clinic, session, kind="override", rule=rule, verdict="fail", reason="seen")
    write(clinic, session, role="pharmacist", kind="sign_off")
    told = clinic.client("clinician").get("/v1/agreement").json()
    (row,) = (each for each in told["reviewers_among_each_other"]["rules"] if each["rule"] == rule)
    assert (row["n"], row["both_fail"]) == (1, 1)


def test_the_result_is_that_after_review_and_the_machines_stands_beside_it(clinic, upload):
    session = upload(clinic, seed=64, patient_ref="P-77")
    machine = {"grade": session["grade"], "points": session["points"]}
    passed = next(each["rule"] for each in session["report"]["findings"] if each["verdict"] == "pass")
    for rule in failed(session):
        write(clinic, session, kind="override", rule=rule, verdict="pass", reason="seen otherwise")
    write(clinic, session, kind="add", rule=passed, reason="seen")
    write(clinic, session, kind="sign_off")
    rules = {each["rule"]: each for each in clinic.client("clinician").get("/v1/rules").json()["items"]}
    gravest = rules[passed]["severity"]
    expected = {"points": 100 - POINTS[Severity(gravest)], "grade": f"{gravest}_mistakes"}

    detail = read(clinic, session)
    (listed,) = clinic.client("clinician").get("/v1/sessions", params={"grade": expected["grade"]}).json()["items"]
    (progress,) = clinic.client("clinician").get("/v1/patients/P-77/progress").json()["sessions"]
    for told in (detail, listed, progress):
        assert {"grade": told["grade"], "points": told["points"]} == expected
        assert {"grade": told["machine_grade"], "points": told["machine_points"]} == machine
        assert told["mistakes"] == [passed]
    assert detail["report"]["score"] == machine, "a report is never changed"
    (line,) = clinic.client("clinician").get("/v1/export", params={"format": "jsonl"}).text.splitlines()
    assert json.loads(line)["mistakes"] == [passed]
    (row,) = csv.DictReader(io.StringIO(clinic.client("clinician").get("/v1/export").text))
    assert (row["grade"], row["points"], row["mistakes"]) == (expected["grade"], str(expected["points"]), passed)
    assert (row["machine_grade"], row["machine_points"]) == (machine["grade"], str(machine["points"]))
    assert row["machine_mistakes"].split() == sorted(failed(session))
    found = clinic.client("clinician").get("/v1/sessions", params={"rule": passed, "verdict": "fail"}).json()["items"]
    assert [each["id"] for each in found] == [session["id"]]
    (diagnosis,) = (
        each["resource"]
        for each in read(clinic, session, "/fhir")["entry"]
        if each["resource"]["resourceType"] == "DiagnosticReport"
    )
    assert diagnosis["conclusion"].startswith(
        f"{expected['grade'].replace('_', ' ')}, {expected['points']} of 100 points after review; "
        f"by the machine {machine['grade'].replace('_', ' ')}, {machine['points']}"
    )


def test_what_was_undone_gives_the_machines_result_back(clinic, upload):
    session = upload(clinic, seed=65)
    passed = next(each["rule"] for each in session["report"]["findings"] if each["verdict"] == "pass")
    entry = write(clinic, session, kind="override", rule=passed, verdict="fail", reason="seen")
    assert read(clinic, session)["points"] < session["points"]
    assert passed in read(clinic, session)["mistakes"]
    write(clinic, session, kind="undo", undoes=entry["id"])
    told = read(clinic, session)
    assert [told[name] for name in ("grade", "points", "mistakes")] == [
        session[name] for name in ("grade", "points", "mistakes")
    ]


def test_the_page_of_a_report_tells_who_said_what_and_signed(clinic, upload):
    session = upload(clinic, seed=66)
    passed = next(each["rule"] for each in session["report"]["findings"] if each["verdict"] == "pass")
    page = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/report.html").text
    assert "Not signed off." in page
    write(clinic, session, kind="override", rule=passed, verdict="fail", reason="Seen on the video.")
    write(clinic, session, role="pharmacist", kind="sign_off")
    page = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/report.html").text
    assert "mistake (the machine: in order): “Seen on the video.”" in page
    assert re.search(r"Signed off by [^<]+, pharmacist, \d{4}-\d\d-\d\d \d\d:\d\d UTC", page)
    held = read(clinic, session)
    assert f"{held['points']} of 100 points" in page
    assert f"the machine: {session['grade'].replace('_', ' ')}, {session['points']}" in page
