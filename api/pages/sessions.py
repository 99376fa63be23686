"""Sessions, filtered and ordered, a page at a time."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response

from api import viewing
from api.access import Reader, ServiceDep
from api.pages.titles import rule_titles
from api.rendering import render
from api.routes.common import ClinicQuery, Cursor
from api.routes.filters import FilterDep
from api.store.listing import Order
from inhalemon.values import DeviceKind, Grade, Verdict

router = APIRouter(tags=["pages"], include_in_schema=False)
_SHOWN = 50


@router.get("/sessions")
def sessions_page(
    request: Request,
    service: ServiceDep,
    who: Reader,
    narrowed: FilterDep,
    order: Order = Order.NEWEST,
    clinic: ClinicQuery = None,
    cursor: Cursor = None,
) -> Response:
    found = viewing.list_view(service, who, narrowed, order=order, clinic=clinic, cursor=cursor, limit=_SHOWN)
    chosen = {name: value for name, value in request.query_params.items() if name != "cursor" and value}
    if "rule" in chosen:
        chosen.setdefault("verdict", str(Verdict.FAIL))
    content = {
        "page": found,
        "is_narrowed": bool(chosen.keys() - {"order"}),
        "chosen": chosen,
        "older": None if found.next is None else urlencode(chosen | {"cursor": found.next}),
        "is_first": cursor is None,
        "exported": "".join(f"{urlencode({name: value})}&" for name, value in chosen.items() if name != "order"),
        "devices": [str(each) for each in DeviceKind],
        "grades": [str(each) for each in Grade],
        "verdicts": [str(each) for each in Verdict],
        "orders": [str(each) for each in Order],
        "titles": rule_titles(service),
    }
    return render(request, "sessions.html", content, who=who)
