"""What a list of sessions can be narrowed to, as query parameters."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import Depends, Query

from api.moments import from_iso
from api.store.sessions import Filter, State
from inhalemon.values import DeviceKind, Grade, Verdict


async def _filter(
    patient: Annotated[str | None, Query(max_length=64, description="exact patient_ref")] = None,
    device: DeviceKind | None = None,
    grade: Grade | None = None,
    state: Literal[State.UNSCORED, State.SCORED, State.UNUSABLE] | None = None,
    rule: Annotated[str | None, Query(max_length=64, description="a rule that has the verdict given, or any")] = None,
    verdict: Verdict | None = None,
    reviewed: Annotated[bool | None, Query(description="signed off, or not")] = None,
    since: Annotated[datetime | None, Query(description="recorded (or else uploaded) at or after")] = None,
    until: Annotated[datetime | None, Query(description="before")] = None,
) -> Filter:
    return Filter(
        patient_ref=patient,
        device=device,
        grade=grade,
        state=state,
        rule=rule,
        verdict=verdict,
        reviewed=reviewed,
        since_us=_moment(since),
        until_us=_moment(until),
    )


FilterDep = Annotated[Filter, Depends(_filter)]


def is_named(given: Filter) -> bool:
    """Whether the list is of one patient."""
    return given.patient_ref is not None


def _moment(at: datetime | None) -> int | None:
    if at is None:
        return None
    return from_iso((at if at.tzinfo else at.replace(tzinfo=UTC)).isoformat())
