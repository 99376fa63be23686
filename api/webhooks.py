"""Webhooks: signed, retried, and only to hosts that the operator has named.

The signature is `Inhalemon-Signature: t=SECONDS,v1=HEX`, HMAC-SHA256 with the webhook's secret over `SECONDS.BODY`.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import time
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import httpx
import structlog
from starlette.concurrency import run_in_threadpool

from api.moments import SECOND_US, now_us
from api.problems import InvalidError
from api.service import Service
from api.settings import ServiceSettings
from api.store import chores

log = structlog.get_logger(__name__)

EVENTS = ("session.scored", "session.reviewed", "session.signed_off")
_PAUSES_S = (5, 30, 120, 600, 3600, 6 * 3600, 24 * 3600)
_TIMEOUT_S = 10.0
_AT_ONCE = 16


def check_url(url: str, settings: ServiceSettings) -> None:
    """Raises `InvalidError` unless the URL leads to a host that the operator allows, over TLS or to this machine."""
    parts = urlsplit(url)
    host = (parts.hostname or "").lower()
    if host not in settings.webhook_hosts:
        raise InvalidError(
            f"Webhooks to {host or url!r} are not allowed; the operator names hosts in INHALEMON_WEBHOOK_HOSTS."
        )
    is_local = host in {"localhost", "127.0.0.1", "::1"}
    if parts.scheme != "https" and not (parts.scheme == "http" and is_local):
        raise InvalidError("A webhook's URL begins with https://.")
    if parts.username or parts.password or parts.fragment:
        raise InvalidError("A webhook's URL has no user, password or fragment.")


def signature(secret: str, body: bytes, at_s: int) -> str:
    """The header's value."""
    mark = hmac.new(secret.encode(), f"{at_s}.".encode() + body, hashlib.sha256).hexdigest()
    return f"t={at_s},v1={mark}"


class Sender:
    """Sends what is due."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._client = httpx.AsyncClient(timeout=_TIMEOUT_S, follow_redirects=False, trust_env=False)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        await self._client.aclose()

    async def deliver_due(self) -> None:
        """One try for each delivery whose time has come."""
        due = await run_in_threadpool(self._due)
        await asyncio.gather(*(self._deliver(each) for each in due))

    def _due(self) -> list[chores.Delivery]:
        with self._service.store.read() as connection:
            return chores.deliveries_due(connection, _AT_ONCE)

    async def _deliver(self, delivery: chores.Delivery) -> None:
        headers = {
            "content-type": "application/json",
            "inhalemon-event": delivery.event,
            "inhalemon-delivery": delivery.id,
            "inhalemon-signature": signature(delivery.secret, delivery.body, int(time.time())),
        }
        try:
            check_url(delivery.url, self._service.settings)
            answer = await self._client.post(delivery.url, content=delivery.body, headers=headers)
            told, is_delivered = str(answer.status_code), answer.is_success
        except (httpx.HTTPError, InvalidError) as error:
            told, is_delivered = type(error).__name__, False
        is_last = is_delivered or delivery.attempts >= len(_PAUSES_S)
        next_try_us = None if is_last else now_us() + _PAUSES_S[delivery.attempts] * SECOND_US
        await run_in_threadpool(self._note, delivery.id, told, is_delivered, next_try_us)
        log.info("webhook", delivery=delivery.id, answer=told, attempt=delivery.attempts + 1)

    def _note(self, delivery_id: str, told: str, is_delivered: bool, next_try_us: int | None) -> None:
        with self._service.store.write() as connection:
            chores.note_delivery(
                connection, delivery_id, answer=told, is_delivered=is_delivered, next_try_us=next_try_us
            )
