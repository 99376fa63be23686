"""Idempotency-Key: a request that is sent again with the same key is answered as the first one was, and done once."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import orjson
from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from api.principal import Principal
from api.problems import BadRequestError, ConflictError, InvalidError
from api.service import Service
from api.store import chores

_MAX_LENGTH = 200
_KEPT_HEADERS = ("location", "etag", "content-type")


class Once:
    """One request's use of its key; without a key it does nothing.

        once = Once(service, who, request, fingerprint)
        if (before := await once.begin()) is not None:
            return before
        async with once:
            return await once.finish(answer, session_ids=...)

    A request that fails, or that told of no session, gives its key back, so that it can be sent again.
    """

    def __init__(self, service: Service, who: Principal, request: Request, fingerprint: str) -> None:
        self._service = service
        self._actor_id = who.id
        self._key = request.headers.get("idempotency-key")
        self._fingerprint = f"{request.method} {request.url.path} {fingerprint}"
        self._is_finished = False
        if self._key is not None and not (0 < len(self._key) <= _MAX_LENGTH and self._key.isprintable()):
            raise BadRequestError(f"Idempotency-Key is 1 to {_MAX_LENGTH} printable characters.")

    async def begin(self) -> Response | None:
        """The first request's answer, if there was one. Raises `InvalidError`, `ConflictError`."""
        if self._key is None:
            return None
        before = await run_in_threadpool(self._claim, self._key)
        if before is None:
            return None
        if before.fingerprint != self._fingerprint:
            raise InvalidError(
                "This Idempotency-Key was used for a different request; take a new key for each request.",
                code="idempotency_key_reused",
            )
        if before.status is None:
            raise ConflictError(
                "The first request with this Idempotency-Key is still under way; try again in a moment."
            )
        headers = orjson.loads(before.headers or b"{}") | {"idempotency-replayed": "true"}
        return Response(before.body, status_code=before.status, headers=headers)

    def _claim(self, key: str) -> chores.Remembered | None:
        with self._service.store.write() as connection:
            return chores.claim_key(connection, self._actor_id, key, self._fingerprint)

    async def finish(self, answer: Response, *, session_ids: Sequence[str]) -> Response:
        """Remember the answer, which tells of these sessions, and hand it on."""
        if self._key is not None and session_ids:
            await run_in_threadpool(self._keep, self._key, answer, session_ids)
            self._is_finished = True
        return answer

    def _keep(self, key: str, answer: Response, session_ids: Sequence[str]) -> None:
        headers = {name: answer.headers[name] for name in _KEPT_HEADERS if name in answer.headers}
        with self._service.store.write() as connection:
            chores.keep_answer(
                connection,
                self._actor_id,
                key,
                session_ids=session_ids,
                status=answer.status_code,
                headers=orjson.dumps(headers),
                body=bytes(answer.body),
            )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._key is not None and not self._is_finished:
            await run_in_threadpool(self._release, self._key)

    def _release(self, key: str) -> None:
        with self._service.store.write() as connection:
            chores.release_key(connection, self._actor_id, key)
