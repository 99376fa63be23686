"""The application: its parts put together, its life from start to stop, and how errors become answers."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import structlog
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import RedirectResponse
from fastapi.routing import APIRoute
from fastapi.staticfiles import StaticFiles
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

import inhalemon
from api import background, pages, pairing, routes
from api.access import visitor
from api.answers import problem_answer
from api.middleware import Envelope
from api.problems import (
    BadRequestError,
    InvalidError,
    NotAllowedError,
    NotFoundError,
    NotLoggedInError,
    PasswordChangeError,
    ProblemError,
)
from api.rendering import problem_page
from api.scoring import Scorer
from api.service import Service
from api.settings import ServiceSettings

log = structlog.get_logger(__name__)

_ROUTERS = (*routes.ROUTERS, *pages.ROUTERS)
_STATIC = Path(__file__).parent / "static"
_DESCRIPTION = """
Recorded inhaler sessions in, attitude, phases, measures and technique mistakes out; reviewed by people.

Send `Authorization: Bearer KEY`. Errors are `application/problem+json` (RFC 9457). Lists give opaque cursors.
Decision support for trained staff; not a medical device.
"""


def create_app(settings: ServiceSettings) -> FastAPI:
    """The application for these settings. The database is brought to the present schema when it starts."""

    @contextlib.asynccontextmanager
    async def life(app: FastAPI) -> AsyncIterator[None]:
        service: Service = app.state.service
        await service.pool.start()  # workers load the library while the database is made ready
        try:
            await run_in_threadpool(_make_ready, service)
            chores = asyncio.create_task(background.run(service, app.state.scorer))
            yield
            chores.cancel()
            await asyncio.gather(chores, return_exceptions=True)
            await app.state.scorer.finish()
        finally:
            await service.pool.stop()
            service.close()

    app = FastAPI(
        title="inhalemon",
        version=inhalemon.__version__,
        description=_DESCRIPTION,
        lifespan=life,
        docs_url=None,  # the usual pages load scripts from elsewhere
        redoc_url=None,
        openapi_url="/openapi.json",
        redirect_slashes=False,
    )
    app.state.service = Service(settings)
    app.state.scorer = Scorer(app.state.service)
    app.add_middleware(Envelope, metrics=app.state.service.metrics)
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    for router in _ROUTERS:
        app.include_router(router)
    app.mount("/static", _Static(directory=_STATIC), name="static")
    return app


class _Static(StaticFiles):
    """Files that browsers may keep, if they ask each time whether they are still the same."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        answer = super().file_response(*args, **kwargs)
        answer.headers["cache-control"] = "no-cache"
        return answer


def _make_ready(service: Service) -> None:
    pairing.make_ready(service)
    removed = service.files.sweep()
    background.resume(service)
    log.info("ready", database=service.store.url.get_backend_name(), unfinished_uploads_removed=removed)


def _is_for_a_person(request: Request) -> bool:
    return not request.url.path.startswith("/v1/") and "text/html" in request.headers.get("accept", "")


async def _on_problem(request: Request, error: Exception) -> Response:
    problem = error if isinstance(error, ProblemError) else ProblemError("")
    if _is_for_a_person(request) and request.method == "GET":
        if isinstance(problem, NotLoggedInError):
            here = request.url.path + (f"?{request.url.query}" if request.url.query else "")
            return RedirectResponse(f"/login?next={quote(here)}", status_code=303)
        if isinstance(problem, PasswordChangeError):
            return RedirectResponse("/password", status_code=303)
    return await _answer(request, problem)


async def _answer(request: Request, problem: ProblemError) -> Response:
    if not _is_for_a_person(request):
        return problem_answer(problem, request.url.path)
    return problem_page(request, problem, await visitor(request))


async def _on_invalid(request: Request, error: Exception) -> Response:
    """What pydantic found, place by place; the values themselves are not repeated, they may be a patient's."""
    found = error.errors() if isinstance(error, RequestValidationError) else []
    places = [{"where": ".".join(str(part) for part in each["loc"]), "wanted": each["msg"]} for each in found]
    told = "; ".join(f"{each['where']}: {each['wanted']}" for each in places)
    return await _answer(request, InvalidError(f"{told}.", errors=places))


async def _on_http(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 500
    headers = dict(error.headers or {}) if isinstance(error, HTTPException) else {}
    if status == 404:
        return await _answer(request, NotFoundError("There is nothing at this address."))
    if status == 405:  # the framework names the methods of the first route alone
        headers["allow"] = ", ".join(sorted(_methods(request.url.path)))
    kind = _KINDS.get(status, ProblemError)
    problem = kind(str(getattr(error, "detail", "")), headers=headers)
    problem.status = status
    if kind is ProblemError and status < 500:
        problem.kind, problem.title = f"http-{status}", "The request cannot be answered as it is"
    return await _answer(request, problem)


_KINDS = {400: BadRequestError, 403: NotAllowedError}


def _methods(path: str) -> set[str]:
    """What can be done at a path."""
    every = (route for router in _ROUTERS for route in router.routes if isinstance(route, APIRoute))
    return {method for route in every if route.path_regex.match(path) for method in route.methods or ()}
