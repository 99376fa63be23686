"""Logging in with one's organisation: out to its provider, and back."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse
from starlette.concurrency import run_in_threadpool

from api.access import ServiceDep
from api.problems import NotAllowedError, NotFoundError, NotInstalledError
from api.routes.login import is_secure, local_path, open_login
from api.service import Service
from api.store import people

if TYPE_CHECKING:
    from api.oidc import Provider

router = APIRouter(prefix="/login/oidc", tags=["pages"], include_in_schema=False)
_COOKIE = "inhalemon_oidc"


def _oidc() -> ModuleType:
    try:
        from api import oidc  # noqa: PLC0415
    except ImportError as error:
        raise NotInstalledError("OIDC needs the extra `oidc`: pip install 'inhalemon[oidc]'.") from error
    return oidc


def _provider(request: Request, service: Service) -> Provider:
    if service.settings.oidc_issuer is None:
        raise NotFoundError("There is no login by organisation here.")
    if getattr(request.app.state, "oidc", None) is None:
        request.app.state.oidc = _oidc().Provider(service.settings)
    provider: Provider = request.app.state.oidc
    return provider


def _redirect_uri(request: Request, service: Service) -> str:
    base = service.settings.public_url or str(request.base_url)
    return f"{base.rstrip('/')}{router.prefix}/callback"


@router.get("")
async def begin(request: Request, service: ServiceDep, next: str | None = None) -> Response:  # noqa: A002
    provider = _provider(request, service)
    attempt = _oidc().Attempt.begin(local_path(next))
    answer = RedirectResponse(await provider.login_url(attempt, _redirect_uri(request, service)), status_code=303)
    answer.set_cookie(
        _COOKIE,
        attempt.sealed(service.secret),
        httponly=True,
        samesite="lax",
        secure=is_secure(request, service),
        max_age=600,
        path=router.prefix,
    )
    return answer


@router.get("/callback")
async def come_back(
    request: Request,
    service: ServiceDep,
    code: Annotated[str, Query(max_length=2000)] = "",
    state: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    provider = _provider(request, service)
    attempt = _oidc().Attempt.unsealed(service.secret, request.cookies.get(_COOKIE, ""), state)
    if not code:
        raise NotAllowedError("Your organisation did not let you in.")
    name = await provider.name_of(attempt, code, _redirect_uri(request, service))
    answer = RedirectResponse(attempt.target, status_code=303)
    await run_in_threadpool(_let_in, request, service, name, answer)
    answer.delete_cookie(_COOKIE, path=router.prefix)
    return answer


def _let_in(request: Request, service: Service, name: str, answer: Response) -> None:
    with service.store.write() as connection:
        user = people.user_named(connection, name)
        if user is None or not user.is_active:
            raise NotAllowedError(
                "Your organisation knows you, this service does not; ask its administrator to add you."
            )
        if user.must_change_password:  # made here with a one-time password that nobody needs now
            people.drop_password(connection, user.id)
    open_login(request, service, user, answer, "oidc")
