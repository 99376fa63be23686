"""What to review next."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from api import reviewing, viewing
from api.access import Reviewer, ServiceDep
from api.pages.titles import rule_titles
from api.rendering import render
from api.routes.common import ClinicQuery, SessionId

router = APIRouter(tags=["pages"], include_in_schema=False)
_SHOWN = 50


@router.get("/queue")
def queue_page(request: Request, service: ServiceDep, who: Reviewer, clinic: ClinicQuery = None) -> Response:
    found = viewing.queue_view(service, who, clinic=clinic, limit=_SHOWN)
    content = {"items": found.items, "clinic": clinic, "titles": rule_titles(service), "limit": _SHOWN}
    return render(request, "queue.html", content, who=who)


@router.post("/queue/next")
def take_next(service: ServiceDep, who: Reviewer, clinic: ClinicQuery = None, after: str | None = None) -> Response:
    """Take the next session and go there; where nothing is left, the empty queue says so."""
    taken = reviewing.take_next(service, who, clinic=clinic, after=after)
    nothing = f"/queue?clinic={clinic}" if clinic else "/queue"
    target = nothing if taken is None else f"/sessions/{taken.session.id}"
    return Response(status_code=204, headers={"HX-Redirect": target})


@router.post("/queue/{session_id}/take")
def take(service: ServiceDep, who: Reviewer, session_id: SessionId) -> Response:
    """Hold one session of the queue, and go there."""
    reviewing.hold(service, who, session_id)
    return Response(status_code=204, headers={"HX-Redirect": f"/sessions/{session_id}"})
