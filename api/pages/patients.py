"""A patient over time: points, steps kept, and which mistakes stay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response

from api import viewing
from api.access import Reader, ServiceDep
from api.models import Progress
from api.pages.titles import rule_titles
from api.problems import AmbiguousPatientError
from api.rendering import render, words_for
from api.routes.common import ClinicQuery
from api.words import Words

router = APIRouter(prefix="/patients", tags=["pages"], include_in_schema=False)
_COLUMNS = 24  # sessions in the table of mistakes, the newest


@router.get("/{ref}")
def patient_page(
    request: Request,
    service: ServiceDep,
    who: Reader,
    ref: Annotated[str, Path(max_length=64)],
    clinic: ClinicQuery = None,
) -> Response:
    try:
        found = viewing.progress_view(service, who, ref, clinic=clinic)
    except AmbiguousPatientError as problem:
        return render(request, "patient_choice.html", {"problem": problem}, who=who, status=problem.status)
    words, titles = words_for(request), rule_titles(service)
    shown = found.sessions[-_COLUMNS:]
    content = {
        "progress": found,
        "shown": shown,
        "rules": sorted(found.rules, key=lambda rule: (-rule.failed, rule.rule)),
        "titles": titles,
        "drawn": _drawn(found, words, titles),
    }
    return render(request, "patient.html", content, who=who)


def _drawn(found: Progress, words: Words, titles: Mapping[str, str]) -> dict[str, Any]:
    """What the script draws."""
    return {
        "sessions": [
            {
                "at_s": each.at.timestamp(),
                "points": each.points,
                "kept": None if not each.steps_decided else 100 * each.steps_kept / each.steps_decided,
                "url": f"/sessions/{each.session}",
            }
            for each in found.sessions
        ],
        "words": {"points": words("points"), "kept": words("steps kept, %")},
    }
