"""How people come in and leave: a form with a password, or the organisation's own login by OpenID Connect.

Forms are posted as `application/x-www-form-urlencoded` with the field `csrf_token`. Before there is a login, that token
is bound to a cookie of its own, so that no other site can log somebody in.
"""

from __future__ import annotations

import hmac
import secrets
from typing import Annotated

import structlog
from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import RedirectResponse
from starlette.concurrency import run_in_threadpool

from api import auth
from api.access import COOKIE, Anybody, ServiceDep, principal_of_login
from api.moments import SECOND_US, now_us
from api.principal import Principal
from api.problems import CrowdedError, CsrfError, InvalidError, ProblemError, TooManyRequestsError
from api.rendering import render
from api.service import Service
from api.store import people

log = structlog.get_logger(__name__)
router = APIRouter(tags=["pages"], include_in_schema=False)

_VISITOR_COOKIE = "inhalemon_visitor"


def is_secure(request: Request, service: Service) -> bool:
    return service.settings.is_secure or request.url.scheme == "https"


def local_path(target: str | None) -> str:
    """Where to go after the login: a path here, never another site."""
    if (
        target
        and target.startswith("/")
        and not target.startswith("//")
        and "\\" not in target
        and target.isprintable()
    ):
        return target
    return "/"


@router.get("/login")
def login_page(request: Request, service: ServiceDep, next: str | None = None) -> Response:  # noqa: A002
    if (token := request.cookies.get(COOKIE)) and principal_of_login(service, token) is not None:
        return RedirectResponse(local_path(next), status_code=303)
    return _login_form(request, service, next, told=None, status=200)


def _login_form(request: Request, service: Service, target: str | None, *, told: str | None, status: int) -> Response:
    visitor = request.cookies.get(_VISITOR_COOKIE) or secrets.token_urlsafe(24)
    content = {
        "csrf_token": service.secret.mac("visitor", visitor).hex(),
        "next": local_path(target),
        "told": told,
        "has_oidc": service.settings.oidc_issuer is not None,
    }
    answer = render(request, "login.html", content, status=status)
    answer.set_cookie(
        _VISITOR_COOKIE, visitor, httponly=True, samesite="lax", secure=is_secure(request, service), max_age=3600
    )
    return answer


@router.post("/login")
async def log_in(
    request: Request,
    service: ServiceDep,
    name: Annotated[str, Form(max_length=100)],
    password: Annotated[str, Form(max_length=500)],
    csrf_token: Annotated[str, Form(max_length=100)] = "",
    next: Annotated[str | None, Form(max_length=500)] = None,  # noqa: A002
) -> Response:
    visitor = request.cookies.get(_VISITOR_COOKIE, "")
    wanted = service.secret.mac("visitor", visitor).hex()
    if not visitor or not hmac.compare_digest(wanted.encode(), csrf_token.encode()):
        return _login_form(request, service, next, told="The form was too old. Please log in again.", status=403)
    address = request.client.host if request.client else "unknown"
    tried = f"{name.strip().lower()}@{address}"
    try:
        service.limits.addresses.take(address)
        service.limits.logins.take(tried)
        user = await service.hashing.run(lambda: auth.check_password(service.store, name.strip(), password))
    except (TooManyRequestsError, CrowdedError) as error:
        answer = _login_form(request, service, next, told=error.detail, status=error.status)
        answer.headers.update(error.headers)
        return answer
    if user is None:
        await run_in_threadpool(_note_failure, service, name.strip())
        return _login_form(request, service, next, told="Name or password is wrong.", status=401)
    service.limits.logins.forgive(tried)
    service.limits.addresses.give_back(address)
    answer = RedirectResponse("/password" if user.must_change_password else local_path(next), status_code=303)
    await run_in_threadpool(open_login, request, service, user, answer, "password")
    return answer


def _note_failure(service: Service, name: str) -> None:
    """A failed login of somebody who exists is in the audit of their clinics."""
    with service.store.write() as connection:
        user = people.user_named(connection, name)
        if user is not None:
            for clinic_id in user.clinics.values():
                service.audit.record(connection, clinic_id, f"user:{user.name}", "login.failed")


def open_login(request: Request, service: Service, user: people.User, answer: Response, by: str) -> None:
    """Open a login for this person and give its cookie to the answer."""
    token = secrets.token_urlsafe(32)
    seconds = round(service.settings.session_hours * 3600)
    with service.store.write() as connection:
        people.open_login(connection, user.id, auth.token_hash(token), now_us() + seconds * SECOND_US)
        for clinic_id in user.clinics.values():
            service.audit.record(connection, clinic_id, f"user:{user.name}", "login", by=by)
    answer.set_cookie(
        COOKIE, token, httponly=True, samesite="lax", secure=is_secure(request, service), max_age=seconds, path="/"
    )
    answer.delete_cookie(_VISITOR_COOKIE)


@router.post("/logout")
def log_out(request: Request, service: ServiceDep, who: Anybody) -> Response:
    with service.store.write() as connection:
        people.close_login(connection, auth.token_hash(request.cookies.get(COOKIE, "")))
        for clinic_id in who.clinic_ids:
            service.audit.record(connection, clinic_id, who.actor, "logout")
    answer = RedirectResponse("/login", status_code=303)
    answer.delete_cookie(COOKIE, path="/")
    return answer


@router.get("/password")
def password_page(request: Request, who: Anybody) -> Response:
    return _password_form(request, who, told=None, status=200)


def _password_form(request: Request, who: Principal, *, told: str | None, status: int) -> Response:
    content = {
        "csrf_token": who.csrf_token,
        "is_forced": who.must_change_password,
        "told": told,
        "min_length": auth.MIN_PASSWORD_LENGTH,
    }
    return render(request, "password.html", content, who=who, status=status)


@router.post("/password")
async def change_password(
    request: Request,
    service: ServiceDep,
    who: Anybody,
    old: Annotated[str, Form(max_length=500)],
    new: Annotated[str, Form(max_length=500)],
) -> Response:
    if who.kind != "user":
        raise CsrfError("Only people have passwords.")
    try:
        service.limits.logins.take(f"password:{who.id}")
        user = await service.hashing.run(lambda: auth.check_password(service.store, who.name, old))
        if user is None:
            raise InvalidError("The old password is wrong.")
        if old == new:
            raise InvalidError("The new password is the old one; choose another.")
        password_hash = await service.hashing.run(lambda: auth.hash_password(new))
    except ProblemError as problem:
        return _password_form(request, who, told=problem.detail, status=problem.status)
    answer = RedirectResponse("/", status_code=303)
    await run_in_threadpool(_change, request, service, user, password_hash, answer)
    return answer


def _change(request: Request, service: Service, user: people.User, password_hash: str, answer: Response) -> None:
    with service.store.write() as connection:
        people.set_password(connection, user.id, password_hash, must_change=False)
        for clinic_id in user.clinics.values():
            service.audit.record(connection, clinic_id, f"user:{user.name}", "password.changed")
    open_login(request, service, user, answer, "new password")
