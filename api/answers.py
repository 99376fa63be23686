"""Answers: JSON through orjson, problems as RFC 9457, and the security headers that all of them carry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import orjson
from fastapi import Response

from api.problems import ProblemError

PROBLEM_TYPE = "application/problem+json"

# The pages' own policy: everything from this server, nothing inline, nothing framed.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; font-src 'self'; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
# A report page brings its own style and script, and gets an origin of its own: it can reach nothing.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'; sandbox allow-scripts allow-downloads allow-popups"
)
SECURITY_HEADERS: Mapping[str, str] = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Json(Response):
    """JSON, of anything that orjson takes; stored JSON goes in as `orjson.Fragment` and is not parsed again."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:  # Starlette's own signature
        return orjson.dumps(content, option=orjson.OPT_NON_STR_KEYS)


def problem_answer(problem: ProblemError, instance: str | None = None) -> Response:
    """The one form in which this service says no."""
    return Response(
        orjson.dumps(problem.body(instance)),
        status_code=problem.status,
        headers=problem.headers,
        media_type=PROBLEM_TYPE,
    )
