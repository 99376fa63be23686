"""Machine against reviewers, and reviewers among each other."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request, Response

from api import viewing
from api.access import Reader, ServiceDep
from api.pages.titles import rule_titles
from api.rendering import render
from api.routes.common import ClinicQuery

router = APIRouter(prefix="/agreement", tags=["pages"], include_in_schema=False)
# Who alone calls something a mistake: what the columns beside "Both" are called.
_SIDES: Final = {
    "machine": ("Only the machine: mistake", "Only the reviewer: mistake"),
    "people": ("Only the one: mistake", "Only the other: mistake"),
}


@router.get("")
def agreement_page(request: Request, service: ServiceDep, who: Reader, clinic: ClinicQuery = None) -> Response:
    found = viewing.agreement_view(service, who, clinic=clinic)
    tables = [
        ("Machine against reviewers", "machine", found.machine_and_reviewers, *_SIDES["machine"]),
        ("Reviewers among each other", "people", found.reviewers_among_each_other, *_SIDES["people"]),
    ]
    return render(
        request, "agreement.html", {"tables": tables, "titles": rule_titles(service), "clinic": clinic}, who=who
    )
