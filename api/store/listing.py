"""Sessions in lists: narrowed, in an order, a page at a time or all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from sqlalchemy import Connection, exists, select, tuple_

from api.store.engine import streamed
from api.store.sessions import Session, State, sessions_where
from api.store.tables import clinics, findings, reports, sessions


class Order(StrEnum):
    NEWEST = "-recorded"
    OLDEST = "recorded"
    LAST_UPLOADED = "-uploaded"
    FIRST_UPLOADED = "uploaded"
    WORST = "worst"


@dataclass(frozen=True, slots=True)
class Filter:
    """What a list is narrowed to; `None` narrows nothing."""

    patient_ref: str | None = None
    patient_part: str | None = None
    device: str | None = None
    grade: str | None = None
    state: str | None = None
    rule: str | None = None
    verdict: str | None = None
    reviewed: bool | None = None  # signed off
    has_reviews: bool | None = None
    since_us: int | None = None
    until_us: int | None = None

    @property
    def is_of_patient(self) -> bool:
        return self.patient_ref is not None or self.patient_part is not None


def _conditions(clinic_ids: Sequence[str], given: Filter) -> list[Any]:
    own = sessions.c.clinic_id == clinic_ids[0] if len(clinic_ids) == 1 else sessions.c.clinic_id.in_(clinic_ids)
    conditions: list[Any] = [own]
    for column, value in (
        (sessions.c.patient_ref, given.patient_ref),
        (sessions.c.device, given.device),
        (sessions.c.grade, given.grade),
        (sessions.c.state, given.state),
    ):
        if value is not None:
            conditions.append(column == value)
    if given.patient_part is not None:
        conditions.append(sessions.c.patient_ref.icontains(given.patient_part, autoescape=True))
    if given.rule is not None or given.verdict is not None:
        wanted = [findings.c.session_id == sessions.c.id]
        if given.rule is not None:
            wanted.append(findings.c.rule == given.rule)
        if given.verdict is not None:
            wanted.append(findings.c.verdict == given.verdict)
        conditions.append(exists().where(*wanted))
    if given.reviewed is not None:
        conditions.append(
            sessions.c.signed_off_us.is_not(None) if given.reviewed else sessions.c.signed_off_us.is_(None)
        )
    if given.has_reviews is not None:
        conditions.append((sessions.c.n_reviews > 0) == given.has_reviews)
    if given.since_us is not None:
        conditions.append(sessions.c.happened_at_us >= given.since_us)
    if given.until_us is not None:
        conditions.append(sessions.c.happened_at_us < given.until_us)
    return conditions


_KEYS = {
    Order.NEWEST: (sessions.c.happened_at_us, sessions.c.id),
    Order.OLDEST: (sessions.c.happened_at_us, sessions.c.id),
    Order.LAST_UPLOADED: (sessions.c.uploaded_at_us, sessions.c.id),
    Order.FIRST_UPLOADED: (sessions.c.uploaded_at_us, sessions.c.id),
    Order.WORST: (sessions.c.merit, sessions.c.happened_at_us, sessions.c.id),
}


def page(
    connection: Connection,
    clinic_ids: Sequence[str],
    given: Filter,
    order: Order,
    after: Sequence[int | str] | None,
    limit: int,
) -> list[Session]:
    """Up to `limit` sessions in the order asked for, behind the position `after` (see `position`)."""
    key = _KEYS[order]
    is_falling = order.startswith("-")
    statement = sessions_where(*_conditions(clinic_ids, given))
    if after is not None:
        statement = statement.where(tuple_(*key) < tuple(after) if is_falling else tuple_(*key) > tuple(after))
    statement = statement.order_by(*(column.desc() if is_falling else column.asc() for column in key)).limit(limit)
    return [Session(**row) for row in connection.execute(statement).mappings()]


def position(session: Session, order: Order) -> tuple[int | str, ...]:
    """Where a session stands in an order: what a cursor holds."""
    return tuple(getattr(session, column.name) for column in _KEYS[order])


def stream(connection: Connection, clinic_ids: Sequence[str], given: Filter) -> Iterator[tuple[Session, bytes | None]]:
    """All sessions with their newest report, oldest first."""
    statement = (
        sessions_where(*_conditions(clinic_ids, given))
        .add_columns(reports.c.body)
        .order_by(sessions.c.happened_at_us, sessions.c.id)
    )
    for row in streamed(connection, statement):
        values = dict(row)
        body = values.pop("body")
        yield Session(**values), body


def every(connection: Connection, clinic_ids: Sequence[str], given: Filter) -> Iterator[Session]:
    """All sessions, oldest first."""
    statement = sessions_where(*_conditions(clinic_ids, given))
    for row in streamed(connection, statement.order_by(sessions.c.happened_at_us, sessions.c.id)):
        yield Session(**row)


def clinics_of_patient(connection: Connection, clinic_ids: Sequence[str], patient_ref: str) -> dict[str, str]:
    """The slug and identifier of each of these clinics that has a scored session of such a patient."""
    statement = (
        select(clinics.c.slug, clinics.c.id)
        .where(
            clinics.c.id.in_(clinic_ids),
            exists().where(
                sessions.c.clinic_id == clinics.c.id,
                sessions.c.patient_ref == patient_ref,
                sessions.c.state == State.SCORED,
            ),
        )
        .order_by(clinics.c.slug)
    )
    return {row.slug: row.id for row in connection.execute(statement)}
