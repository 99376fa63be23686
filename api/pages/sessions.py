"""Sessions, filtered and ordered, a page at a time."""

from __future__ import annotations

from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response

from api.access import Reader, ServiceDep
from api.pages.titles import rule_titles
from api.rendering import render
from api.routes import sessions
from api.routes.common import Cursor
from api.routes.filters import FilterDep
from api.store.sessions import Order
from inhalemon.values import DeviceKind, Grade, Verdict

router = APIRouter(tags=["pages"], include_in_schema=False)


@router.get("/sessions")
def sessions_page(
    request: Request,
    service: ServiceDep,
    who: Reader,
    narrowed: FilterDep,
    order: Order = Order.NEWEST,
    cursor: Cursor = None,
) -> Response:
    found = sessions.list_sessions(service, who, narrowed, order, None, cursor, 50)
    chosen = {name: value for name, value in request.query_params.items() if name != "cursor" and value}
    content = {
        "page": found,
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
