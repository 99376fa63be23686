"""The way in, the choice of language, and the colours that pages share with the library's own page of a report."""

from __future__ import annotations

from importlib import resources

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from api.access import Anybody, ServiceDep
from api.problems import NotFoundError, PasswordChangeError
from api.rendering import LANGUAGE_COOKIE, places
from api.routes.login import is_secure, local_path
from api.words import LANGUAGES

router = APIRouter(tags=["pages"], include_in_schema=False)
_YEAR_S = 365 * 24 * 3600


@router.get("/")
def home(who: Anybody) -> Response:
    """The first page that this person may see."""
    if who.must_change_password:
        raise PasswordChangeError("Choose a password of your own at /password.")
    allowed = places(who)
    return RedirectResponse(allowed[0].path if allowed else "/password", status_code=303)


@router.get("/language/{code}")
def choose_language(request: Request, service: ServiceDep, code: str, next: str | None = None) -> Response:  # noqa: A002
    if code not in LANGUAGES:
        raise NotFoundError(f"There are no pages in {code!r}.")
    answer = RedirectResponse(local_path(next), status_code=303)
    answer.set_cookie(
        LANGUAGE_COOKIE, code, max_age=_YEAR_S, samesite="lax", httponly=True, secure=is_secure(request, service)
    )
    return answer


@router.get("/palette.css")
def palette() -> Response:
    """Colours of phases, severities and curves: one file for these pages and for reports."""
    css = resources.files("inhalemon.report").joinpath("templates/palette.css").read_text(encoding="utf-8")
    return Response(css, media_type="text/css", headers={"cache-control": "no-cache"})
