"""Keys for programs, and webhooks."""

from __future__ import annotations

import secrets
from typing import Annotated

from fastapi import APIRouter, Path, Response

from api import auth, present, webhooks
from api.access import Administrator, ServiceDep
from api.models import KeyIn, KeyMade, KeyOut, WebhookIn, WebhookMade, WebhookOut
from api.moments import to_datetime
from api.routes.common import problems
from api.store import chores, people

router = APIRouter(prefix="/v1", tags=["keys and webhooks"])
Id = Annotated[str, Path(pattern=r"^[a-z2-7]{26}$")]


@router.get("/keys", summary="The keys of your clinic, without their secret part", responses=dict(problems()))
def list_keys(service: ServiceDep, who: Administrator) -> list[KeyOut]:
    with service.store.read() as connection:
        return [present.key(each) for each in people.keys_of(connection, who.clinic_ids)]


@router.post("/keys", status_code=201, summary="Make a key; it is shown this once", responses=dict(problems(404)))
def make_key(service: ServiceDep, who: Administrator, given: KeyIn) -> KeyMade:
    clinic_id = who.one_clinic(given.clinic)
    with service.store.write() as connection:
        made = auth.make_key(
            connection,
            service.secret,
            clinic_id,
            given.role,
            scopes=None if given.scopes is None else frozenset(given.scopes),
            label=given.label,
            created_by=who.actor,
            days=given.days,
        )
        service.audit.record(connection, clinic_id, who.actor, "key.made", f"key:{made.prefix}", role=given.role)
        found = next(each for each in people.keys_of(connection, (clinic_id,)) if each.id == made.id)
    return KeyMade(**present.key(found).model_dump(), key=made.key)


@router.delete("/keys/{key_id}", status_code=204, summary="Revoke a key at once", responses=dict(problems(404)))
def revoke_key(service: ServiceDep, who: Administrator, key_id: Id) -> Response:
    with service.store.write() as connection:
        found = people.revoke_key(connection, who.clinic_ids, key_id)
        service.audit.record(connection, found.clinic_id, who.actor, "key.revoked", f"key:{found.prefix}")
    return Response(status_code=204)


@router.get("/webhooks", summary="The webhooks of your clinic", responses=dict(problems()))
def list_webhooks(service: ServiceDep, who: Administrator) -> list[WebhookOut]:
    with service.store.read() as connection:
        return [_webhook(each) for each in chores.webhooks_of(connection, who.clinic_ids)]


@router.post("/webhooks", status_code=201, summary="Be told of what happens", responses=dict(problems(404)))
def add_webhook(service: ServiceDep, who: Administrator, given: WebhookIn) -> WebhookMade:
    webhooks.check_url(given.url, service.settings)
    clinic_id = who.one_clinic(given.clinic)
    events = " ".join(sorted(set(given.events)))
    with service.store.write() as connection:
        hook = chores.add_webhook(connection, clinic_id, given.url, f"whsec_{secrets.token_urlsafe(32)}", events)
        service.audit.record(connection, clinic_id, who.actor, "webhook.added", hook.id)
    return WebhookMade(**_webhook(hook).model_dump(), secret=hook.secret)


@router.delete("/webhooks/{webhook_id}", status_code=204, summary="Remove a webhook", responses=dict(problems(404)))
def drop_webhook(service: ServiceDep, who: Administrator, webhook_id: Id) -> Response:
    with service.store.write() as connection:
        hook = chores.drop_webhook(connection, who.clinic_ids, webhook_id)
        service.audit.record(connection, hook.clinic_id, who.actor, "webhook.removed", hook.id)
    return Response(status_code=204)


def _webhook(hook: chores.Webhook) -> WebhookOut:
    return WebhookOut(id=hook.id, url=hook.url, events=hook.events.split(), created_at=to_datetime(hook.created_at_us))
