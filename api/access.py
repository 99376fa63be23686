"""Access as typed dependencies: an endpoint says in its signature what it takes to call it.

    def list_sessions(who: Reader, service: ServiceDep) -> ...

A program sends `Authorization: Bearer KEY`. A person sends the cookie of a login, and with everything that changes
something the CSRF token that belongs to it: as the header `X-CSRF-Token`, or as the form's field `csrf_token`.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import APIKeyCookie, HTTPBearer
from starlette.concurrency import run_in_threadpool

from api import auth
from api.principal import Principal, Scope
from api.problems import CsrfError, NotLoggedInError, PasswordChangeError
from api.service import Service
from api.store import people

COOKIE = "inhalemon_session"
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
_FORM = "application/x-www-form-urlencoded"

# For the OpenAPI document only: the checks are below.
_bearer = HTTPBearer(auto_error=False, description="An API key, made with `python -m api add-key` or POST /v1/keys.")
_cookie = APIKeyCookie(name=COOKIE, auto_error=False, description="The cookie of a login.")


async def service_of(request: Request) -> Service:
    """The running service; asynchronous only so that no thread is asked for it."""
    service: Service = request.app.state.service
    return service


ServiceDep = Annotated[Service, Depends(service_of)]


def csrf_token(service: Service, login_token: str) -> str:
    """The token that forms of this login carry."""
    return service.secret.mac("csrf", login_token).hex()


async def principal(
    request: Request,
    service: ServiceDep,
    _key: Annotated[object, Depends(_bearer)] = None,
    _login: Annotated[object, Depends(_cookie)] = None,
) -> Principal:
    """Who asks. Raises `NotLoggedInError`, `CsrfError`, `TooManyRequestsError`."""
    address = request.client.host if request.client else "unknown"
    header = request.headers.get("authorization")
    if header is not None:
        return await _principal_of_header(service, header, address)
    token = request.cookies.get(COOKIE)
    if token is None:
        raise NotLoggedInError
    found = await run_in_threadpool(principal_of_login, service, token)
    if found is None:
        raise NotLoggedInError("The login has run out; log in again.")
    if request.method not in _SAFE:
        await require_csrf(request, found.csrf_token or "")
    return found


async def _principal_of_header(service: Service, header: str, address: str) -> Principal:
    scheme, _, key = header.partition(" ")
    if scheme.lower() != "bearer" or not key:
        raise NotLoggedInError
    try:
        found = await run_in_threadpool(auth.principal_of_key, service.store, service.secret, key.strip())
    except NotLoggedInError:
        service.limits.bad_keys.take(address)  # wrong keys alone are charged: a good one behind the same address works
        raise
    service.limits.keys.take(found.id)
    return found


def principal_of_login(service: Service, token: str) -> Principal | None:
    """The person behind a login's cookie, or `None` when it has run out."""
    with service.store.read() as connection:
        user = people.user_of_login(connection, auth.token_hash(token))
    return None if user is None else auth.principal_of_user(user, csrf_token(service, token))


async def visitor(request: Request) -> Principal | None:
    """The person whose browser this is, for pages that anybody may see."""
    token = request.cookies.get(COOKIE)
    service = await service_of(request)
    return None if token is None else await run_in_threadpool(principal_of_login, service, token)


async def require_csrf(request: Request, wanted: str) -> None:
    """Raises `CsrfError` unless the request carries the token. (A form that was read here can be read again.)"""
    given = request.headers.get("x-csrf-token")
    if given is None and request.headers.get("content-type", "").startswith(_FORM):
        value = (await request.form()).get("csrf_token")
        given = value if isinstance(value, str) else None
    if given is None or not hmac.compare_digest(given.encode(), wanted.encode()):
        raise CsrfError("Load the page again, then repeat what you did.")


Anybody = Annotated[Principal, Depends(principal)]


def _allow(scope: Scope) -> Callable[[Principal], Awaitable[Principal]]:
    async def allowed(who: Anybody) -> Principal:
        if who.must_change_password:
            raise PasswordChangeError("Choose a password of your own at /password.")
        who.require(scope)
        return who

    return allowed


Uploader = Annotated[Principal, Depends(_allow(Scope.UPLOAD))]
Reader = Annotated[Principal, Depends(_allow(Scope.READ))]
Reviewer = Annotated[Principal, Depends(_allow(Scope.REVIEW))]
Corrector = Annotated[Principal, Depends(_allow(Scope.CORRECT))]
Exporter = Annotated[Principal, Depends(_allow(Scope.EXPORT))]
Administrator = Annotated[Principal, Depends(_allow(Scope.ADMIN))]
