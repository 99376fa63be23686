"""Reviews are appended, never changed; the queue gives each session to one reviewer at a time."""

from __future__ import annotations

import pytest

from api import following, verdicts
from api.store.reviews import Review, ReviewKind


@pytest.fixture
def session(clinic, upload):
    return upload(clinic, seed=40)


def write(clinic, session, role="clinician", headers=None, **entry):
    return clinic.client(role).post(f"/v1/sessions/{session['id']}/reviews", json=entry, headers=headers or {})


def history(clinic, session):
    return clinic.client("clinician").get(f"/v1/sessions/{session['id']}/reviews")


def a_rule(session, *verdicts_wanted):
    return next(each["rule"] for each in session["report"]["findings"] if each["verdict"] in verdicts_wanted)


def opposite(session, rule):
    (said,) = (each["verdict"] for each in session["report"]["findings"] if each["rule"] == rule)
    return "pass" if said == "fail" else "fail"


def test_a_finding_is_confirmed_another_overridden_and_both_stay(clinic, session):
    first, second = (each["rule"] for each in session["report"]["findings"][:2])
    assert write(clinic, session, kind="confirm", rule=first).status_code == 201
    verdict = opposite(session, second)
    made = write(clinic, session, kind="override", rule=second, verdict=verdict, reason="seen on video")
    assert made.status_code == 201, made.text
    told = history(clinic, session)
    assert [(each["kind"], each["rule"], each["version"]) for each in told.json()["entries"]] == [
        ("confirm", first, 1),
        ("override", second, 2),
    ]
    assert told.json()["entries"][1]["verdict"] == verdict
    assert told.json()["entries"][1]["machine_verdict"] != verdict
    assert told.headers["etag"] == '"2"'


def test_who_comes_second_is_told_so_and_nothing_is_written(clinic, session):
    first = write(clinic, session, headers={"if-match": '"0"'}, kind="comment", reason="spacer in use")
    second = write(clinic, session, headers={"if-match": '"0"'}, kind="sign_off")
    assert (first.status_code, second.status_code) == (201, 412)
    assert second.json()["version"] == 1
    assert len(history(clinic, session).json()["entries"]) == 1
    assert write(clinic, session, headers={"if-match": first.headers["etag"]}, kind="sign_off").status_code == 201


def test_a_sign_off_is_undone_by_another_entry(clinic, session):
    signed = write(clinic, session, kind="sign_off").json()
    assert history(clinic, session).json()["signed_off_at"] is not None
    assert clinic.client("clinician").get("/v1/review-queue").json()["items"] == []
    stranger = write(clinic, session, role="administrator", kind="undo", undoes=signed["id"])
    assert stranger.status_code == 409, "one takes back one's own entries only"
    assert write(clinic, session, kind="undo", undoes=signed["id"]).status_code == 201
    told = history(clinic, session).json()
    assert told["signed_off_at"] is None
    assert [(each["kind"], each["is_undone"]) for each in told["entries"]] == [("sign_off", True), ("undo", False)]
    assert write(clinic, session, kind="undo", undoes=signed["id"]).status_code == 422, "and only once"
    assert len(clinic.client("clinician").get("/v1/review-queue").json()["items"]) == 1


@pytest.mark.parametrize(
    "entry",
    [
        {"kind": "override", "rule": "no_press", "reason": "x"},
        {"kind": "override", "rule": "no_press", "verdict": "fail"},
        {"kind": "confirm"},
        {"kind": "confirm", "rule": "there_is_no_such_rule"},
        {"kind": "sign_off", "rule": "no_press"},
        {"kind": "comment"},
        {"kind": "undo"},
        {"kind": "undo", "undoes": "nothing"},
        {"kind": "applaud"},
        {"kind": "comment", "reason": "x", "more": 1},
    ],
)
def test_an_entry_that_makes_no_sense_is_refused(clinic, session, entry):
    assert write(clinic, session, **entry).status_code == 422
    assert history(clinic, session).json()["entries"] == []


def test_the_queue_gives_each_session_to_one_reviewer_at_a_time(clinic, upload):
    ids = {upload(clinic, seed=each)["id"] for each in (41, 42)}
    one, other = clinic.client("clinician"), clinic.client("pharmacist")
    first = one.post("/v1/review-queue/next").json()
    second = other.post("/v1/review-queue/next").json()
    assert {first["session"]["id"], second["session"]["id"]} == ids
    assert [each["session"]["id"] for each in other.get("/v1/review-queue").json()["items"]] == [
        second["session"]["id"]
    ]
    assert other.put(f"/v1/sessions/{first['session']['id']}/lease").status_code == 409
    assert one.delete(f"/v1/sessions/{first['session']['id']}/lease").status_code == 204
    assert other.put(f"/v1/sessions/{first['session']['id']}/lease").status_code == 200
    assert one.post("/v1/review-queue/next").status_code == 204


def test_the_queue_begins_with_the_worst_and_of_these_the_oldest(clinic, upload):
    for seed, day in ((43, "03"), (44, "01"), (45, "02")):
        upload(clinic, seed=seed, recorded_at=f"2025-11-{day}T10:00:00Z")
    items = [each["session"] for each in clinic.client("clinician").get("/v1/review-queue").json()["items"]]
    rank = ["critical_mistakes", "major_mistakes", "not_assessable", "minor_mistakes", "correct"]
    keys = [(rank.index(each["grade"]), each["recorded_at"]) for each in items]
    assert keys == sorted(keys)
    assert len(keys) == 3


def test_signing_off_releases_the_lease_and_tells_who_did_it(clinic, session):
    clinic.client("clinician").put(f"/v1/sessions/{session['id']}/lease")
    write(clinic, session, kind="sign_off")
    listed = clinic.client("clinician").get("/v1/sessions", params={"reviewed": True}).json()["items"]
    assert [each["id"] for each in listed] == [session["id"]]
    assert clinic.client("clinician").get("/v1/sessions", params={"reviewed": False}).json()["items"] == []


# ------------------------------------------------------------------------------------------ what follows from reviews


def entry(kind, rule=None, verdict=None, reviewer="a", number=[0], undoes=None):  # noqa: B006  # counts on purpose
    number[0] += 1
    return Review(
        id=str(number[0]),
        session_id="s",
        version=number[0],
        kind=kind,
        rule=rule,
        verdict=verdict,
        machine_verdict=None,
        reason=None,
        undoes=undoes,
        report_id=None,
        reviewer_id=reviewer,
        reviewer=reviewer,
        at_us=0,
    )


MACHINE = {"no_press": "pass", "press_late": "fail", "lip_seal": "not_assessable"}


def test_a_sign_off_confirms_what_was_decided_and_not_contradicted():
    said = verdicts.by_reviewer(
        MACHINE,
        [entry(ReviewKind.OVERRIDE, "press_late", "pass"), entry(ReviewKind.SIGN_OFF), entry("comment", reviewer="b")],
        None,
    )
    assert said == {"a": {"no_press": "pass", "press_late": "pass"}}


@pytest.mark.parametrize(
    ("counts", "direction"),
    [
        ([5, 4, 3, 2, 1, 0], "improving"),
        ([0, 1, 2, 3, 4, 5], "worsening"),
        ([2, 3, 2, 3, 2, 3], "steady"),
        ([1, 1, 1, 1, 1], "steady"),
        ([9, 0, 0], "unknown"),
    ],
)
def test_a_trend_is_told_when_chance_would_seldom_make_it(counts, direction):
    assert following.trend([10.0 * n for n in range(len(counts))], counts).direction == direction


def test_the_slope_is_mistakes_per_thirty_days():
    assert following.trend([0.0, 10.0, 20.0, 30.0], [6, 4, 2, 0]).mistakes_per_30_days == pytest.approx(-6.0)


def test_agreement_counts_what_machine_and_reviewer_said(clinic, upload):
    """Expected counts are made from the reports themselves: whatever the machine says, the reviewer's part is known."""
    expected: dict[str, list[int]] = {}
    for seed in (46, 47, 48):
        session = upload(clinic, seed=seed)
        decided = {f["rule"]: f["verdict"] for f in session["report"]["findings"] if f["verdict"] in {"pass", "fail"}}
        contradicted = sorted(decided)[0] if decided else None
        if contradicted is not None:
            verdict = opposite(session, contradicted)
            entry_ = {"kind": "override", "rule": contradicted, "verdict": verdict, "reason": "seen"}
            assert write(clinic, session, **entry_).status_code == 201
        assert write(clinic, session, kind="sign_off").status_code == 201
        for rule, said in decided.items():
            truth = opposite(session, rule) if rule == contradicted else said
            cell = {("fail", "fail"): 0, ("fail", "pass"): 1, ("pass", "fail"): 2, ("pass", "pass"): 3}[said, truth]
            expected.setdefault(rule, [0, 0, 0, 0])[cell] += 1
    told = clinic.client("clinician").get("/v1/agreement").json()["machine_and_reviewers"]
    found = {
        each["rule"]: [each["both_fail"], each["only_first_fails"], each["only_second_fails"], each["both_pass"]]
        for each in told["rules"]
    }
    assert found == expected
    for row in told["rules"]:
        if row["specificity"] is not None:
            assert 0 <= row["specificity"]["low"] <= row["specificity"]["value"] <= row["specificity"]["high"] <= 1


def test_a_patients_progress_is_in_order_of_time_and_after_review(clinic, upload):
    late = upload(clinic, seed=49, patient_ref="P-9", recorded_at="2025-11-20T10:00:00Z")
    early = upload(clinic, seed=50, patient_ref="P-9", recorded_at="2025-11-01T10:00:00Z")
    upload(clinic, seed=51, patient_ref="P-10")
    rule = a_rule(early, "pass", "not_assessable", "indeterminate")
    write(clinic, early, kind="add", rule=rule, reason="seen on video")
    told = clinic.client("pharmacist").get("/v1/patients/P-9/progress").json()
    assert [each["session"] for each in told["sessions"]] == [early["id"], late["id"]]
    assert rule in told["sessions"][0]["mistakes"]
    assert {each["rule"]: each["failed"] for each in told["rules"]}[rule] >= 1
    assert clinic.client("pharmacist").get("/v1/patients/P-11/progress").status_code == 404
