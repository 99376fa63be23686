"""What a list of sessions can be narrowed to, as query parameters."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Literal

from fastapi import Depends, Query
from pydantic import BeforeValidator

from api.moments import from_datetime
from api.store.listing import Filter
from api.store.sessions import State
from inhalemon.values import DeviceKind, Grade, Verdict


def _as_written(given: object) -> object:
    """Refuses a bare number: pydantic takes it for seconds or milliseconds since 1970, whichever looks likelier."""
    if isinstance(given, str) and not re.match(r"\d{4}-\d\d-\d\d", given):
        raise ValueError("expected ISO 8601, such as 2026-11-20T08:30:00Z")
    return given


_Moment = Annotated[datetime, BeforeValidator(_as_written)]


async def _filter(
    patient: Annotated[str | None, Query(max_length=64, description="exact patient_ref")] = None,
    patient_part: Annotated[str | None, Query(max_length=64, description="a part of patient_ref, in any case")] = None,
    device: DeviceKind | None = None,
    grade: Grade | None = None,
    state: Literal[State.UNSCORED, State.SCORED, State.UNUSABLE] | None = None,
    rule: Annotated[str | None, Query(max_length=64, description="a rule that failed, or has `verdict`")] = None,
    verdict: Verdict | None = None,
    reviewed: Annotated[bool | None, Query(description="signed off, or not")] = None,
    since: Annotated[_Moment | None, Query(description="recorded (or else uploaded) at or after")] = None,
    until: Annotated[_Moment | None, Query(description="before")] = None,
) -> Filter:
    return Filter(
        patient_ref=patient,
        patient_part=patient_part,
        device=device,
        grade=grade,
        state=state,
        rule=rule,
        verdict=Verdict.FAIL if verdict is None and rule is not None else verdict,
        reviewed=reviewed,
        since_us=None if since is None else from_datetime(since),
        until_us=None if until is None else from_datetime(until),
    )


FilterDep = Annotated[Filter, Depends(_filter)]
