"""Reviews (appended, never changed), the queue of what to review next, and its leases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

from sqlalchemy import ColumnElement, Connection, delete, exists, select, update

from api.moments import SECOND_US, new_id, now_us
from api.problems import ConflictError
from api.store.engine import insert_new
from api.store.sessions import Session, State, sessions_where
from api.store.tables import leases, reviews, sessions


class ReviewKind(StrEnum):
    CONFIRM = "confirm"  # the machine is right about this rule
    OVERRIDE = "override"  # it is not: another verdict, with a reason
    ADD = "add"  # a mistake that the machine has not found
    COMMENT = "comment"
    SIGN_OFF = "sign_off"
    UNDO = "undo"  # takes back an entry of one's own


@dataclass(frozen=True, slots=True)
class Review:
    id: str
    session_id: str
    version: int
    kind: str
    rule: str | None
    verdict: str | None
    machine_verdict: str | None
    reason: str | None
    undoes: str | None
    report_id: str | None
    reviewer_id: str
    reviewer: str
    at_us: int


@dataclass(frozen=True, slots=True)
class Lease:
    session_id: str
    reviewer_id: str
    reviewer: str
    expires_at_us: int


def append(
    connection: Connection,
    session: Session,
    kind: ReviewKind,
    *,
    reviewer_id: str,
    reviewer: str,
    rule: str | None = None,
    verdict: str | None = None,
    machine_verdict: str | None = None,
    reason: str | None = None,
    undoes: str | None = None,
) -> Review:
    """Append one entry to a session that the caller holds locked, and that the caller settles then."""
    entry = Review(
        id=new_id(),
        session_id=session.id,
        version=session.n_reviews + 1,
        kind=kind,
        rule=rule,
        verdict=verdict,
        machine_verdict=machine_verdict,
        reason=reason,
        undoes=undoes,
        report_id=session.report_id,
        reviewer_id=reviewer_id,
        reviewer=reviewer,
        at_us=now_us(),
    )
    connection.execute(reviews.insert().values({each.name: getattr(entry, each.name) for each in fields(entry)}))
    connection.execute(
        update(sessions).where(sessions.c.id == session.id).values(n_reviews=entry.version, reviewed_at_us=entry.at_us)
    )
    return entry


def history(connection: Connection, session_id: str) -> list[Review]:
    """Every entry of a session, in the order they were written, those taken back included."""
    statement = select(reviews).where(reviews.c.session_id == session_id).order_by(reviews.c.version)
    return [Review(**row) for row in connection.execute(statement).mappings()]


def histories_of(connection: Connection, session_ids: Sequence[str]) -> dict[str, list[Review]]:
    """Every entry of each of these sessions, in the order they were written."""
    found: dict[str, list[Review]] = {session_id: [] for session_id in session_ids}
    statement = select(reviews).where(reviews.c.session_id.in_(session_ids))
    for row in connection.execute(statement.order_by(reviews.c.session_id, reviews.c.version)).mappings():
        found[row["session_id"]].append(Review(**row))
    return found


# ------------------------------------------------------------------------------------------ queue and leases


def _held_by_others(reviewer_id: str) -> ColumnElement[bool]:
    return exists().where(
        leases.c.session_id == sessions.c.id,
        leases.c.reviewer_id != reviewer_id,
        leases.c.expires_at_us > now_us(),
    )


def queue(connection: Connection, clinic_ids: Sequence[str], reviewer_id: str, limit: int) -> list[Session]:
    """What to review next: scored, not signed off, held by nobody else; the worst first, of these the oldest."""
    wanted: list[Any] = [
        sessions.c.clinic_id.in_(clinic_ids),
        sessions.c.state == State.SCORED,
        sessions.c.signed_off_us.is_(None),
        ~_held_by_others(reviewer_id),
    ]
    statement = sessions_where(*wanted).order_by(sessions.c.merit, sessions.c.happened_at_us, sessions.c.id)
    return [Session(**row) for row in connection.execute(statement.limit(limit)).mappings()]


def try_lease(connection: Connection, session_id: str, reviewer_id: str, reviewer: str, seconds: float) -> Lease | None:
    """Hold a session for one reviewer, or hold it longer; `None` while another holds it."""
    now = now_us()
    wanted = Lease(session_id, reviewer_id, reviewer, now + round(seconds * SECOND_US))
    row = {each.name: getattr(wanted, each.name) for each in fields(wanted)}
    if insert_new(connection, leases, row):
        return wanted
    free = (leases.c.reviewer_id == reviewer_id) | (leases.c.expires_at_us <= now)
    taken = connection.execute(update(leases).where(leases.c.session_id == session_id, free).values(**row))
    return wanted if taken.rowcount else None


def take_lease(connection: Connection, session_id: str, reviewer_id: str, reviewer: str, seconds: float) -> Lease:
    """As `try_lease`, but raises `ConflictError` while another holds it."""
    lease = try_lease(connection, session_id, reviewer_id, reviewer, seconds)
    if lease is None:
        raise ConflictError("Somebody else is reviewing this session; take the next one.")
    return lease


def release_lease(connection: Connection, session_id: str, reviewer_id: str) -> None:
    connection.execute(delete(leases).where(leases.c.session_id == session_id, leases.c.reviewer_id == reviewer_id))


def leases_of(connection: Connection, session_ids: Sequence[str]) -> dict[str, Lease]:
    """Leases that have not run out, by session."""
    statement = select(leases).where(leases.c.session_id.in_(session_ids), leases.c.expires_at_us > now_us())
    return {row["session_id"]: Lease(**row) for row in connection.execute(statement).mappings()}
