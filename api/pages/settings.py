"""People, keys and webhooks of a clinic, for its administrators. Secrets are shown in the one answer that made them."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Form, Request, Response
from pydantic import ValidationError

from api.access import Administrator, ServiceDep
from api.models import KeyIn, UserChange, UserIn, WebhookIn
from api.principal import SCOPES, Principal, Role, Scope
from api.problems import InvalidError
from api.rendering import render
from api.routes import keys, people
from api.service import Service

router = APIRouter(prefix="/settings", tags=["pages"], include_in_schema=False)

Text = Annotated[str, Form(max_length=2000)]
Several = Annotated[list[str], Form(default_factory=list)]


@router.get("")
def settings_page(request: Request, service: ServiceDep, who: Administrator) -> Response:
    return render(request, "settings.html", _content(service, who), who=who)


def _content(service: Service, who: Principal) -> dict[str, Any]:
    return {
        "users": people.list_users(service, who),
        "keys": keys.list_keys(service, who),
        "webhooks": keys.list_webhooks(service, who),
        "clinics": sorted(who.clinics),
        "roles": [str(role) for role in Role],
        "scopes": [str(scope) for scope in Scope],
        "scopes_of": {str(role): sorted(scopes) for role, scopes in SCOPES.items()},
        "events": ("session.scored", "session.reviewed", "session.signed_off"),
        "made": None,
    }


def _part(
    request: Request, service: Service, who: Principal, name: str, made: dict[str, str] | None = None
) -> Response:
    return render(request, f"_{name}.html", _content(service, who) | {"made": made}, who=who)


@router.post("/users")
def add_user(
    request: Request, service: ServiceDep, who: Administrator, name: Text, role: Text, clinics: Several
) -> Response:
    try:
        given = UserIn.model_validate({"name": name, "role": role, "clinics": clinics or None})
    except ValidationError as error:
        raise _invalid(error) from error
    made = people.add_user(service, who, given)
    return _part(request, service, who, "users", {"name": made.name, "secret": made.one_time_password})


@router.post("/users/{name}")
def change_user(
    request: Request,
    service: ServiceDep,
    who: Administrator,
    name: str,
    act: Annotated[str, Form(pattern="^(lock|unlock|reset)$")],
) -> Response:
    change = UserChange(reset_password=True) if act == "reset" else UserChange(is_active=act == "unlock")
    changed = people.change_user(service, who, name, change)
    password = getattr(changed, "one_time_password", None)
    made = None if password is None else {"name": changed.name, "secret": password}
    return _part(request, service, who, "users", made)


@router.post("/keys")
def make_key(
    request: Request,
    service: ServiceDep,
    who: Administrator,
    role: Text,
    scopes: Several,
    label: Text = "",
    days: Text = "",
    clinic: Text = "",
) -> Response:
    try:
        given = KeyIn.model_validate(
            {"role": role, "scopes": scopes or None, "label": label, "days": days or None, "clinic": clinic or None}
        )
    except ValidationError as error:
        raise _invalid(error) from error
    made = keys.make_key(service, who, given)
    return _part(request, service, who, "keys", {"name": made.label or made.prefix, "secret": made.key})


@router.post("/keys/{key_id}/revoke")
def revoke_key(request: Request, service: ServiceDep, who: Administrator, key_id: keys.Id) -> Response:
    keys.revoke_key(service, who, key_id)
    return _part(request, service, who, "keys")


@router.post("/webhooks")
def add_webhook(
    request: Request, service: ServiceDep, who: Administrator, url: Text, events: Several, clinic: Text = ""
) -> Response:
    try:
        given = WebhookIn.model_validate({"url": url, "events": events, "clinic": clinic or None})
    except ValidationError as error:
        raise _invalid(error) from error
    made = keys.add_webhook(service, who, given)
    return _part(request, service, who, "webhooks", {"name": made.url, "secret": made.secret})


@router.post("/webhooks/{webhook_id}/drop")
def drop_webhook(request: Request, service: ServiceDep, who: Administrator, webhook_id: keys.Id) -> Response:
    keys.drop_webhook(service, who, webhook_id)
    return _part(request, service, who, "webhooks")


def _invalid(error: ValidationError) -> InvalidError:
    return InvalidError("; ".join(f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()))
