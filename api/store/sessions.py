"""Recorded sessions, their reports (every version is kept) and findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

import orjson
from sqlalchemy import Connection, Select, bindparam, delete, func, select, update

from api.moments import SECOND_US, new_id, now_us
from api.problems import NotFoundError
from api.store.engine import insert_new, streamed
from api.store.tables import clinics, erasures, findings, reports, sessions
from inhalemon.values import Finding, Score

_MERIT = {
    "critical_mistakes": 0,
    "major_mistakes": 1,
    "not_assessable": 2,
    "minor_mistakes": 3,
    "correct": 4,
}
_UNKNOWN_MERIT = 5


class State(StrEnum):
    UNSCORED = "unscored"  # the bytes are kept, scoring is due
    SCORED = "scored"
    UNUSABLE = "unusable"  # the reader refused it when it was scored later


@dataclass(frozen=True, slots=True)
class Session:
    id: str
    clinic_id: str
    clinic: str  # slug
    sha256: str
    n_bytes: int
    suffix: str
    session_ref: str | None
    device: str | None
    patient_ref: str | None
    sidecar: bytes | None
    recorded_at_us: int | None
    happened_at_us: int
    uploaded_at_us: int
    uploaded_by: str
    state: str
    attempts: int
    next_try_us: int | None
    failure: bytes | None
    report_id: str | None
    duration_s: float | None
    grade: str | None  # after review, as merit and points
    merit: int
    points: int | None
    n_reviews: int
    reviewed_at_us: int | None
    signed_off_us: int | None
    machine_grade: str | None  # of the newest report
    machine_points: int | None


@dataclass(frozen=True, slots=True)
class StoredReport:
    id: str
    session_id: str
    version: int
    created_at_us: int
    pipeline_version: str
    settings_digest: str
    rules_digest: str
    grade: str
    points: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Outcome:
    """What holds of a session: a report's findings after review, and what they are worth."""

    findings: tuple[Finding, ...]
    score: Score


_SESSIONS: Select[Any] = (
    select(
        *(sessions.c[each.name] for each in fields(Session) if each.name in sessions.c),
        clinics.c.slug.label("clinic"),
        reports.c.grade.label("machine_grade"),
        reports.c.points.label("machine_points"),
    )
    .join_from(sessions, clinics)
    .outerjoin(reports, reports.c.id == sessions.c.report_id)
)


# Built once: these run with every upload.
_FIND = _SESSIONS.where(sessions.c.id == bindparam("of_session"))
_FIND_LOCKED = _FIND.with_for_update(of=sessions)
_NEWEST = (
    select(reports).where(reports.c.session_id == bindparam("of_session")).order_by(reports.c.version.desc()).limit(1)
)
_KNOWN = _SESSIONS.where(sessions.c.clinic_id == bindparam("of_clinic"), sessions.c.sha256 == bindparam("bytes"))
_KEEP = reports.insert()
_KEEP_FINDINGS = findings.insert()
_CHANGE = update(sessions).where(sessions.c.id == bindparam("of_session"))


def sessions_where(*conditions: Any) -> Select[Any]:  # SQLAlchemy's conditions have no one type
    """The statement that selects sessions (joined with their newest report), for the modules beside this one."""
    return _SESSIONS.where(*conditions)


# ------------------------------------------------------------------------------------------ storing and finding


def add(
    connection: Connection,
    clinic_id: str,
    *,
    session_id: str,
    sha256: str,
    n_bytes: int,
    suffix: str,
    session_ref: str | None,
    device: str | None,
    patient_ref: str | None,
    sidecar: bytes | None,
    recorded_at_us: int | None,
    uploaded_by: str,
    attempts: int,
    first_try_s: float,
) -> tuple[Session, bool]:
    """The stored session, and whether it is new: the same bytes at the same clinic are the same session.

    The request that brought it scores it; the background tries `first_try_s` later, in case that came to nothing.
    """
    now = now_us()
    is_new = insert_new(
        connection,
        sessions,
        {
            "id": session_id,
            "clinic_id": clinic_id,
            "sha256": sha256,
            "n_bytes": n_bytes,
            "suffix": suffix,
            "session_ref": session_ref,
            "device": device,
            "patient_ref": patient_ref,
            "sidecar": sidecar,
            "recorded_at_us": recorded_at_us,
            "happened_at_us": now if recorded_at_us is None else recorded_at_us,
            "uploaded_at_us": now,
            "uploaded_by": uploaded_by,
            "state": State.UNSCORED,
            "attempts": attempts,
            "next_try_us": now + round(first_try_s * SECOND_US),
            "merit": _UNKNOWN_MERIT,
            "n_reviews": 0,
        },
    )
    return Session(**connection.execute(_KNOWN, {"of_clinic": clinic_id, "bytes": sha256}).mappings().one()), is_new


def find(connection: Connection, clinic_ids: Sequence[str], session_id: str, *, lock: bool = False) -> Session:
    """One session of these clinics; `lock` holds it until the transaction ends. Raises `NotFoundError`."""
    statement = _FIND_LOCKED if lock else _FIND
    row = connection.execute(statement, {"of_session": session_id}).mappings().one_or_none()
    if row is None or row["clinic_id"] not in clinic_ids:
        raise NotFoundError("There is no such session here.")
    return Session(**row)


def mistakes_of(connection: Connection, session_ids: Sequence[str]) -> dict[str, list[str]]:
    """The mistakes of each session, after review."""
    statement = select(findings.c.session_id, findings.c.rule).where(
        findings.c.session_id.in_(session_ids), findings.c.verdict == "fail"
    )
    found: dict[str, list[str]] = {session_id: [] for session_id in session_ids}
    for row in connection.execute(statement.order_by(findings.c.rule)):
        found[row.session_id].append(row.rule)
    return found


def verdicts_of(connection: Connection, session_ids: Sequence[str]) -> dict[str, dict[str, str]]:
    """Rule to verdict of each session, after review."""
    found: dict[str, dict[str, str]] = {session_id: {} for session_id in session_ids}
    statement = select(findings.c.session_id, findings.c.rule, findings.c.verdict)
    for row in connection.execute(statement.where(findings.c.session_id.in_(session_ids)).order_by(findings.c.rule)):
        found[row.session_id][row.rule] = row.verdict
    return found


def count_by_state(connection: Connection) -> dict[str, int]:
    rows = connection.execute(select(sessions.c.state, func.count()).group_by(sessions.c.state))
    return {row[0]: row[1] for row in rows}


# ------------------------------------------------------------------------------------------ scoring


def keep_report(
    connection: Connection,
    session: Session,
    body: bytes,
    outcome: Outcome,
    *,
    device: str,
    session_ref: str | None,
    patient_ref: str | None,
    recorded_at_us: int | None,
) -> tuple[Session, StoredReport]:
    """Keep a report as the session's newest, with what holds after review; one equal to the newest is not kept twice.

    Another report than the one that was signed off opens the session again. Returns both as they stand.
    """
    told = orjson.loads(body)
    signed_off_us = session.signed_off_us
    newest = None if session.report_id is None else report(connection, session.id)
    if newest is not None and newest.body == body:
        kept = newest
    else:
        kept = StoredReport(
            id=new_id(),
            session_id=session.id,
            version=1 if newest is None else newest.version + 1,
            created_at_us=now_us(),
            pipeline_version=told["pipeline_version"],
            settings_digest=told["settings_digest"],
            rules_digest=told["rules_digest"],
            grade=told["score"]["grade"],
            points=told["score"]["points"],
            body=body,
        )
        connection.execute(_KEEP, {each.name: getattr(kept, each.name) for each in fields(kept)})
        signed_off_us = None
    recorded = session.recorded_at_us if recorded_at_us is None else recorded_at_us
    changes: dict[str, Any] = {
        "state": str(State.SCORED),
        "attempts": 0,
        "next_try_us": None,
        "failure": None,
        "report_id": kept.id,
        "device": device,
        "sidecar": session.sidecar,
        "session_ref": session.session_ref or session_ref,
        "patient_ref": session.patient_ref or patient_ref,
        "recorded_at_us": recorded,
        "happened_at_us": session.uploaded_at_us if recorded is None else recorded,
        "duration_s": told["duration_s"],
        "signed_off_us": signed_off_us,
        **_keep_findings(connection, session, outcome, are_first=newest is None),
    }
    connection.execute(_CHANGE, {"of_session": session.id, **changes})
    return replace(session, **changes, machine_grade=kept.grade, machine_points=kept.points), kept


def settle(connection: Connection, session: Session, outcome: Outcome, *, signed_off_us: int | None) -> None:
    """Keep what holds of a session after an entry of its review."""
    changes = {"signed_off_us": signed_off_us, **_keep_findings(connection, session, outcome)}
    connection.execute(_CHANGE, {"of_session": session.id, **changes})


def _keep_findings(
    connection: Connection, session: Session, outcome: Outcome, *, are_first: bool = False
) -> dict[str, Any]:
    """Keep the findings that hold; returns the session's columns that tell what they are worth."""
    if not are_first:
        connection.execute(delete(findings).where(findings.c.session_id == session.id))
    rows = [
        {
            "session_id": session.id,
            "rule": finding.rule,
            "verdict": str(finding.verdict),
            "severity": None if finding.severity is None else str(finding.severity),
            "clinic_id": session.clinic_id,
        }
        for finding in outcome.findings
    ]
    if rows:
        connection.execute(_KEEP_FINDINGS, rows)
    grade, points = str(outcome.score.grade), outcome.score.points
    return {"grade": grade, "merit": _MERIT.get(grade, _UNKNOWN_MERIT), "points": points}


def note_failure(
    connection: Connection, session_id: str, failure: dict[str, object], *, next_try_us: int | None, is_final: bool
) -> None:
    """Remember why the try failed; a session that was scored before keeps its report and state."""
    values: dict[str, Any] = {
        "next_try_us": next_try_us,
        "failure": orjson.dumps(failure),
    }
    statement = update(sessions).where(sessions.c.id == session_id, sessions.c.state != State.SCORED)
    connection.execute(statement.values(values | ({"state": State.UNUSABLE} if is_final else {})))


def due(connection: Connection, limit: int) -> list[Session]:
    """Unscored sessions whose next try has come, the longest waiting first."""
    statement = _SESSIONS.where(sessions.c.state == State.UNSCORED, sessions.c.next_try_us <= now_us())
    rows = connection.execute(statement.order_by(sessions.c.next_try_us).limit(limit)).mappings()
    return [Session(**row) for row in rows]


def begin_try(connection: Connection, session_id: str, seconds: float) -> int:
    """Count a try before it is made, as it may take the service with it; the next is due in `seconds`. How many now."""
    statement = update(sessions).where(sessions.c.id == session_id).returning(sessions.c.attempts)
    changes = {"attempts": sessions.c.attempts + 1, "next_try_us": now_us() + round(seconds * SECOND_US)}
    return connection.scalar(statement.values(changes)) or 0


def put_off(connection: Connection, session_id: str, *, attempts: int) -> None:
    """Make a session due that nobody could try: after so many tries, without this one."""
    statement = update(sessions).where(sessions.c.id == session_id, sessions.c.state == State.UNSCORED)
    connection.execute(statement.values(next_try_us=now_us(), attempts=attempts))


def all_due(connection: Connection, max_attempts: int) -> int:
    """Make every unscored session due now, after a start, unless its tries are used up; returns how many there are."""
    statement = update(sessions).where(sessions.c.state == State.UNSCORED, sessions.c.attempts < max_attempts)
    return connection.execute(statement.values(next_try_us=now_us())).rowcount


def give_up(connection: Connection, max_attempts: int, failure: dict[str, object]) -> int:
    """Try no more what used up its tries without an answer: each ended with the service. Returns how many there are."""
    statement = update(sessions).where(
        sessions.c.state == State.UNSCORED, sessions.c.attempts >= max_attempts, sessions.c.next_try_us.is_not(None)
    )
    return connection.execute(statement.values(next_try_us=None, failure=orjson.dumps(failure))).rowcount


def report(connection: Connection, session_id: str, version: int | None = None) -> StoredReport | None:
    """One version of a session's report, or the newest."""
    statement = _NEWEST if version is None else _NEWEST.where(reports.c.version == version)
    row = connection.execute(statement, {"of_session": session_id}).mappings().one_or_none()
    return None if row is None else StoredReport(**row)


def report_versions(connection: Connection, session_id: str) -> list[StoredReport]:
    statement = select(reports).where(reports.c.session_id == session_id).order_by(reports.c.version)
    return [StoredReport(**row) for row in connection.execute(statement).mappings()]


# ------------------------------------------------------------------------------------------ correcting, erasing


def describe(
    connection: Connection,
    session: Session,
    *,
    sidecar: bytes,
    session_ref: str | None,
    device: str | None,
    patient_ref: str | None,
    recorded_at_us: int | None,
    first_try_s: float,
) -> Session:
    """Give a session that is not scored other metadata, with which it is due to be scored `first_try_s` from now."""
    changes: dict[str, Any] = {
        "sidecar": sidecar,
        "session_ref": session_ref,
        "device": device,
        "patient_ref": patient_ref,
        "recorded_at_us": recorded_at_us,
        "happened_at_us": session.uploaded_at_us if recorded_at_us is None else recorded_at_us,
        "state": str(State.UNSCORED),
        "attempts": 0,
        "next_try_us": now_us() + round(first_try_s * SECOND_US),
        "failure": None,
    }
    connection.execute(_CHANGE, {"of_session": session.id, **changes})
    return replace(session, **changes)


def set_patient(connection: Connection, session_id: str, patient_ref: str | None, sidecar: bytes | None) -> None:
    connection.execute(
        update(sessions).where(sessions.c.id == session_id).values(patient_ref=patient_ref, sidecar=sidecar)
    )


def erase(connection: Connection, session: Session) -> None:
    """Erase a session with all that hangs on it, and note that its files are to go as well."""
    connection.execute(delete(sessions).where(sessions.c.id == session.id))
    insert_new(
        connection,
        erasures,
        {"clinic_id": session.clinic_id, "sha256": session.sha256, "session_id": session.id, "at_us": now_us()},
    )


def erasures_due(connection: Connection) -> list[tuple[str, str, str]]:
    """(clinic, SHA-256, session) of erased sessions whose files may still be there."""
    return [(row.clinic_id, row.sha256, row.session_id) for row in connection.execute(select(erasures))]


def is_kept(connection: Connection, clinic_id: str, sha256: str) -> bool:
    """Whether a session of the clinic has these bytes."""
    found = select(sessions.c.id).where(sessions.c.clinic_id == clinic_id, sessions.c.sha256 == sha256)
    return connection.execute(found).first() is not None


def erased(connection: Connection, clinic_id: str, sha256: str) -> None:
    """The files of an erased session are gone."""
    connection.execute(delete(erasures).where(erasures.c.clinic_id == clinic_id, erasures.c.sha256 == sha256))


def older_than(connection: Connection, happened_before_us: int, limit: int) -> list[Session]:
    statement = _SESSIONS.where(sessions.c.happened_at_us < happened_before_us)
    rows = connection.execute(statement.order_by(sessions.c.happened_at_us).limit(limit)).mappings()
    return [Session(**row) for row in rows]


def contents(connection: Connection) -> Iterator[tuple[str, str]]:
    """(clinic, SHA-256) of every session: which raw files must be there."""
    statement = select(sessions.c.clinic_id, sessions.c.sha256)
    for row in streamed(connection, statement):
        yield row["clinic_id"], row["sha256"]
