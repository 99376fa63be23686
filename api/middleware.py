"""Around every request: an identifier, security headers, a log line, a duration; and a proper answer to a crash."""

from __future__ import annotations

import secrets
import time

import structlog
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.answers import SECURITY_HEADERS, problem_answer
from api.metrics import Metrics
from api.problems import ProblemError

log = structlog.get_logger(__name__)


class Envelope:
    """ASGI middleware. Paths are logged as routes (`/v1/patients/{ref}/progress`), so no reference reaches a log."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request_id = secrets.token_hex(8)
        started_s = time.perf_counter()
        status = 0

        async def send_wrapped(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers["x-request-id"] = request_id
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if scope.get("scheme") == "https":
                    headers.setdefault("strict-transport-security", "max-age=31536000")
            await send(message)

        with structlog.contextvars.bound_contextvars(request=request_id):
            try:
                await self._app(scope, receive, send_wrapped)
            except Exception:
                log.exception("request failed", route=_route(scope))
                if status:
                    raise  # too late for an answer: the connection is cut, so that nobody takes it for whole
                problem = ProblemError(f"The fault was logged; mention request {request_id} when you report it.")
                await problem_answer(problem, scope["path"])(scope, receive, send_wrapped)
            finally:
                duration_s = time.perf_counter() - started_s
                route = _route(scope)
                self._metrics.requests.labels(scope["method"], route, str(status)).observe(duration_s)
                log.info(
                    "request",
                    method=scope["method"],
                    route=route,
                    status=status,
                    duration_ms=round(duration_s * 1000, 1),
                )


def _route(scope: Scope) -> str:
    path = getattr(scope.get("route"), "path", None)
    return path if isinstance(path, str) else "unmatched"
