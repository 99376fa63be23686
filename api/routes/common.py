"""What several endpoints share: the problems they may answer with, paging, narrowing to a clinic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import Path, Query

ClinicQuery = Annotated[str | None, Query(description="one of your clinics; default: all of them", max_length=63)]
SessionId = Annotated[str, Path(pattern=r"^[a-z2-7]{26}$", description="the session's identifier")]
Limit = Annotated[int, Query(ge=1, le=200)]
Cursor = Annotated[str | None, Query(max_length=500, description="`next` of the page before")]

_TOLD = {
    400: "The request cannot be understood",
    401: "A valid key or login is needed",
    403: "The role or key may not do that",
    404: "Not here, or another clinic's",
    408: "The upload stalled",
    409: "Does not fit the present state",
    412: "Somebody was first (If-Match)",
    413: "Too large",
    415: "Not a recording's type",
    422: "A value cannot be used",
    429: "Too many requests",
    500: "A worker crashed; the session is named and kept",
    503: "Saturated; the session is kept, try again after Retry-After",
    507: "The disk is full",
}


def problems(*statuses: int) -> Mapping[int | str, dict[str, Any]]:
    """The problems an endpoint may answer with, for its OpenAPI entry, with those of every endpoint."""
    wanted = sorted({400, 401, 403, 422, 429, *statuses})
    content = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": _TOLD[status], "content": content} for status in wanted}
