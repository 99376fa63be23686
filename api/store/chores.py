"""What keeps the service honest and alive: idempotency keys, webhooks and their deliveries, the readiness write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, bindparam, delete, exists, select, update

from api.moments import DAY_US, SECOND_US, new_id, now_us
from api.problems import NotFoundError
from api.store.engine import insert_new, insert_or_replace
from api.store.tables import deliveries, heartbeat, idempotency, idempotency_sessions, origin, webhooks

_KEY_LIFE_US = DAY_US
_UNFINISHED_LIFE_US = 600 * SECOND_US
_DELIVERY_LIFE_US = 30 * DAY_US


def beat(connection: Connection) -> None:
    """Write one row: the proof that the database can be written to."""
    insert_or_replace(connection, heartbeat, {"id": 1, "at_us": now_us()}, key=["id"])


def bound_to(connection: Connection) -> str | None:
    """The identifier of the data folder that this database belongs to, once it has one."""
    return connection.scalar(select(origin.c.data_id))


def bind(connection: Connection, data_id: str) -> None:
    """Let the database belong to this data folder, unless it belongs to one."""
    insert_new(connection, origin, {"id": 1, "data_id": data_id})


# ------------------------------------------------------------------------------------------ idempotency


@dataclass(frozen=True, slots=True)
class Remembered:
    """What an Idempotency-Key was used for, and what was answered; `status` is `None` while it is under way."""

    fingerprint: str
    status: int | None
    headers: bytes | None
    body: bytes | None


def claim_key(connection: Connection, actor_id: str, key: str, fingerprint: str) -> Remembered | None:
    """`None` when the key is new and now claimed; otherwise what is known of its first use."""
    now = now_us()
    connection.execute(
        delete(idempotency).where(
            (idempotency.c.created_at_us < now - _KEY_LIFE_US)
            | (idempotency.c.status.is_(None) & (idempotency.c.created_at_us < now - _UNFINISHED_LIFE_US))
        )
    )
    row = {"actor_id": actor_id, "key": key, "fingerprint": fingerprint, "created_at_us": now}
    if insert_new(connection, idempotency, row):
        return None
    columns = (idempotency.c.fingerprint, idempotency.c.status, idempotency.c.headers, idempotency.c.body)
    condition = (idempotency.c.actor_id == actor_id) & (idempotency.c.key == key)
    return Remembered(**connection.execute(select(*columns).where(condition)).mappings().one())


def keep_answer(
    connection: Connection,
    actor_id: str,
    key: str,
    *,
    session_ids: Sequence[str],
    status: int,
    headers: bytes,
    body: bytes,
) -> None:
    """Remember an answer about these sessions, of which there is at least one."""
    condition = (idempotency.c.actor_id == actor_id) & (idempotency.c.key == key)
    connection.execute(update(idempotency).where(condition).values(status=status, headers=headers, body=body))
    rows = [{"actor_id": actor_id, "key": key, "session_id": each} for each in sorted(set(session_ids))]
    connection.execute(idempotency_sessions.insert(), rows)


def forget_answers(connection: Connection, session_id: str) -> None:
    """Forget what was answered about a session, which is no longer so or about to be erased."""
    told = idempotency_sessions.c
    its_own = (told.actor_id == idempotency.c.actor_id) & (told.key == idempotency.c.key)
    connection.execute(delete(idempotency).where(exists().where(its_own, told.session_id == session_id)))


def release_unfinished(connection: Connection) -> None:
    """Forget the keys of requests that ended with the server that had them."""
    connection.execute(delete(idempotency).where(idempotency.c.status.is_(None)))


def release_key(connection: Connection, actor_id: str, key: str) -> None:
    """Forget a key whose request failed, so that it can be sent again."""
    condition = (idempotency.c.actor_id == actor_id) & (idempotency.c.key == key)
    connection.execute(delete(idempotency).where(condition))


# ------------------------------------------------------------------------------------------ webhooks


@dataclass(frozen=True, slots=True)
class Webhook:
    id: str
    clinic_id: str
    url: str
    secret: str
    events: str
    created_at_us: int


@dataclass(frozen=True, slots=True)
class Delivery:
    id: str
    event: str
    body: bytes
    created_at_us: int
    attempts: int
    url: str
    secret: str


def add_webhook(connection: Connection, clinic_id: str, url: str, secret: str, events: str) -> Webhook:
    hook = Webhook(new_id(), clinic_id, url, secret, events, now_us())
    connection.execute(
        webhooks.insert().values(
            id=hook.id,
            clinic_id=clinic_id,
            url=url,
            secret=secret,
            events=events,
            created_at_us=hook.created_at_us,
        )
    )
    return hook


def webhooks_of(connection: Connection, clinic_ids: Sequence[str]) -> list[Webhook]:
    statement = select(webhooks).where(webhooks.c.clinic_id.in_(clinic_ids)).order_by(webhooks.c.created_at_us)
    return [Webhook(**row) for row in connection.execute(statement).mappings()]


def drop_webhook(connection: Connection, clinic_ids: Sequence[str], webhook_id: str) -> Webhook:
    """Remove a webhook with what was still to be delivered to it. Raises `NotFoundError`."""
    condition = (webhooks.c.id == webhook_id) & webhooks.c.clinic_id.in_(clinic_ids)
    row = connection.execute(select(webhooks).where(condition)).mappings().one_or_none()
    if row is None:
        raise NotFoundError("There is no such webhook here.")
    connection.execute(delete(webhooks).where(webhooks.c.id == webhook_id))
    return Webhook(**row)


_HOOKS = select(webhooks.c.id, webhooks.c.events).where(webhooks.c.clinic_id == bindparam("of_clinic"))


def announce(connection: Connection, clinic_id: str, event: str, body: bytes) -> int:
    """Note one delivery for each webhook of the clinic that wants the event; returns how many."""
    found = connection.execute(_HOOKS, {"of_clinic": clinic_id}).all()
    hooks = [hook_id for hook_id, events in found if event in events.split()]
    now = now_us()
    for hook_id in hooks:
        connection.execute(
            deliveries.insert().values(
                id=new_id(),
                webhook_id=hook_id,
                event=event,
                body=body,
                created_at_us=now,
                attempts=0,
                next_try_us=now,
            )
        )
    return len(hooks)


def deliveries_due(connection: Connection, limit: int) -> list[Delivery]:
    columns = (
        deliveries.c.id,
        deliveries.c.event,
        deliveries.c.body,
        deliveries.c.created_at_us,
        deliveries.c.attempts,
    )
    statement = (
        select(*columns, webhooks.c.url, webhooks.c.secret)
        .join(webhooks)
        .where(deliveries.c.next_try_us <= now_us())
        .order_by(deliveries.c.next_try_us)
        .limit(limit)
    )
    return [Delivery(**row) for row in connection.execute(statement).mappings()]


def note_delivery(
    connection: Connection, delivery_id: str, *, answer: str, is_delivered: bool, next_try_us: int | None
) -> None:
    values = {
        "attempts": deliveries.c.attempts + 1,
        "last_answer": answer,
        "delivered_at_us": now_us() if is_delivered else None,
        "next_try_us": next_try_us,
    }
    connection.execute(update(deliveries).where(deliveries.c.id == delivery_id).values(values))


def drop_old_deliveries(connection: Connection) -> None:
    old = deliveries.c.created_at_us < now_us() - _DELIVERY_LIFE_US
    connection.execute(delete(deliveries).where(deliveries.c.next_try_us.is_(None), old))
