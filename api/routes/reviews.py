"""Reviews, the queue, and its leases."""

from __future__ import annotations

import hashlib
import re
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from api import present, reviewing, viewing
from api.access import Reader, Reviewer, ServiceDep
from api.answers import Json
from api.idempotency import Once
from api.models import LeaseOut, Queue, QueueItem, ReviewHistory, ReviewIn, ReviewOut
from api.problems import BadRequestError
from api.routes.common import ClinicQuery, Limit, SessionId, problems
from api.store import reviews, sessions

router = APIRouter(prefix="/v1", tags=["reviews"])
IfMatch = Annotated[str | None, Header(description='the version you saw: the ETag of the review, such as "3"')]


def version_of(if_match: str | None) -> int | None:
    """The version that the caller saw, if it says so. Raises `BadRequestError`."""
    if if_match is None or if_match.strip() == "*":
        return None
    found = re.fullmatch(r'\s*(?:W/)?"?(\d{1,9})"?\s*', if_match)
    if found is None:
        raise BadRequestError(f'If-Match is {if_match!r}; expected the ETag that GET gave, such as "3".')
    return int(found[1])


@router.get("/sessions/{session_id}/reviews", summary="Every entry of a review", responses=dict(problems(404)))
def get_reviews(service: ServiceDep, who: Reader, session_id: SessionId, response: Response) -> ReviewHistory:
    found = viewing.review_view(service, who, session_id)
    response.headers["etag"] = f'"{found.version}"'
    return found


@router.post(
    "/sessions/{session_id}/reviews",
    status_code=201,
    summary="Confirm, override, add, comment, sign off, or undo",
    responses={**problems(404, 409, 412), 201: {"model": ReviewOut}},
)
async def add_review(
    request: Request,
    service: ServiceDep,
    who: Reviewer,
    session_id: SessionId,
    given: ReviewIn,
    if_match: IfMatch = None,
) -> Response:
    """Entries are only ever appended. With `If-Match` an entry is refused (412) when somebody else was first."""
    expected = version_of(if_match)
    once = Once(service, who, request, hashlib.sha256(given.model_dump_json().encode()).hexdigest())
    if (before := await once.begin()) is not None:
        return before
    async with once:
        entry, found = await run_in_threadpool(reviewing.append, service, who, session_id, given, expected)
        answer = Json(
            present.review(entry).model_dump(mode="json"),
            status_code=201,
            headers={"etag": f'"{found.session.n_reviews}"', "location": f"/v1/sessions/{session_id}/reviews"},
        )
        return await once.finish(answer, session_ids=[session_id])


# ------------------------------------------------------------------------------------------ queue


@router.get("/review-queue", summary="What to review next: the worst and oldest first", responses=dict(problems(404)))
def get_queue(service: ServiceDep, who: Reviewer, clinic: ClinicQuery = None, limit: Limit = 20) -> Queue:
    """Scored, not signed off, and held by nobody else."""
    return viewing.queue_view(service, who, clinic=clinic, limit=limit)


@router.post(
    "/review-queue/next",
    summary="Take the next session and hold it for yourself",
    responses={**problems(404, 409), 200: {"model": QueueItem}, 204: {"description": "Nothing is left to review"}},
)
def take_next(
    service: ServiceDep,
    who: Reviewer,
    clinic: ClinicQuery = None,
    after: Annotated[
        str | None, Query(description="the session you have just done: released, and not given again")
    ] = None,
) -> Response:
    taken = reviewing.take_next(service, who, clinic=clinic, after=after)
    return Response(status_code=204) if taken is None else Json(taken.model_dump(mode="json"))


@router.put(
    "/sessions/{session_id}/lease", summary="Hold a session, or hold it longer", responses=dict(problems(404, 409))
)
def hold(service: ServiceDep, who: Reviewer, session_id: SessionId) -> LeaseOut:
    return reviewing.hold(service, who, session_id)


@router.delete(
    "/sessions/{session_id}/lease", status_code=204, summary="Let go of a session", responses=dict(problems(404))
)
def let_go(service: ServiceDep, who: Reviewer, session_id: SessionId) -> Response:
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        reviews.release_lease(connection, session.id, who.id)
    return Response(status_code=204)
