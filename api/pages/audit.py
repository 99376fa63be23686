"""Who did or saw what, for administrators."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response

from api import viewing
from api.access import Administrator, ServiceDep
from api.rendering import render
from api.routes.common import Cursor

router = APIRouter(prefix="/audit", tags=["pages"], include_in_schema=False)
_SHOWN = 100


@router.get("")
def audit_page(request: Request, service: ServiceDep, who: Administrator, cursor: Cursor = None) -> Response:
    found = viewing.audit_view(service, who, clinic=None, cursor=cursor, limit=_SHOWN)
    older = None if found.next is None else urlencode({"cursor": found.next})
    return render(request, "audit.html", {"page": found, "older": older, "is_first": cursor is None}, who=who)


@router.post("/verify")
def verify(request: Request, service: ServiceDep, who: Administrator) -> Response:
    return render(request, "_verified.html", {"checks": viewing.audit_checks(service, who, clinic=None)}, who=who)
