"""Machine against reviewers, and reviewers among each other."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from api import viewing
from api.access import Reader, ServiceDep
from api.pages.titles import rule_titles
from api.rendering import render

router = APIRouter(prefix="/agreement", tags=["pages"], include_in_schema=False)


@router.get("")
def agreement_page(request: Request, service: ServiceDep, who: Reader) -> Response:
    found = viewing.agreement_view(service, who, clinic=None)
    tables = [
        ("Machine against reviewers", "machine", found.machine_and_reviewers),
        ("Reviewers among each other", "people", found.reviewers_among_each_other),
    ]
    return render(request, "agreement.html", {"tables": tables, "titles": rule_titles(service)}, who=who)
