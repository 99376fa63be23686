"""Templates, with what every page shows: who is here, in which language, and where one can go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from fastapi import Request, Response
from fastapi.templating import Jinja2Templates
from jinja2 import Environment, FileSystemLoader, StrictUndefined

import inhalemon
from api.principal import Principal, Scope
from api.problems import ProblemError
from api.words import LANGUAGES, Words, preferred
from inhalemon.report.words import DISCLAIMER, INFERRED

LANGUAGE_COOKIE: Final = "inhalemon_language"
_HTMX: Final = {
    "allowEval": False,
    "includeIndicatorStyles": False,
    "selfRequestsOnly": True,
    "defaultSettleDelay": 0,  # what was swapped in works at once, for fast fingers
    "historyCacheSize": 0,  # patients' data stays out of the browser's storage
    "responseHandling": [
        {"code": "204", "swap": False},
        {"code": "[23]..", "swap": True},
        {"code": "412", "swap": True},
        {"code": "[45]..", "swap": False, "error": True},
    ],
}


@dataclass(frozen=True, slots=True)
class Place:
    """A page one can go to."""

    path: str
    title: str
    scope: Scope


_PLACES: Final = (
    Place("/queue", "Review queue", Scope.REVIEW),
    Place("/sessions", "Sessions", Scope.READ),
    Place("/upload", "Upload", Scope.UPLOAD),
    Place("/agreement", "Agreement", Scope.READ),
    Place("/settings", "Settings", Scope.ADMIN),
    Place("/audit", "Audit", Scope.ADMIN),
)

_environment = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_environment.globals.update(
    {
        "htmx_config": _HTMX,
        "languages": LANGUAGES,
        "version": inhalemon.__version__,
        "disclaimer": DISCLAIMER,
        "inferred": INFERRED,
    }
)
_templates = Jinja2Templates(env=_environment)


def words_for(request: Request) -> Words:
    return Words(preferred(request.cookies.get(LANGUAGE_COOKIE), request.headers.get("accept-language", "")))


def places(who: Principal | None) -> list[Place]:
    """Where this person may go."""
    if who is None or who.must_change_password:
        return []
    return [place for place in _PLACES if place.scope in who.scopes]


def render(
    request: Request,
    template: str,
    content: Mapping[str, Any] | None = None,
    *,
    who: Principal | None = None,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """A page or a part of one; `t` translates, `who` is the person."""
    query = f"?{request.url.query}" if request.url.query else ""
    shared = {
        "t": words_for(request),
        "who": who,
        "places": places(who),
        "path": request.url.path,
        "here": request.url.path + query if request.method == "GET" else "/",
    }
    return _templates.TemplateResponse(
        request, template, shared | dict(content or {}), status_code=status, headers=headers
    )


def problem_page(request: Request, problem: ProblemError, who: Principal | None = None) -> Response:
    """A problem as a page for people."""
    content = {"problem": problem, "kind": problem.kind}
    return render(request, "problem.html", content, who=who, status=problem.status, headers=problem.headers)
