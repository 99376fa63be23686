"""Moments and identifiers: microseconds since 1970 inside, ISO 8601 in UTC outside."""

from __future__ import annotations

import base64
import secrets
import time
from datetime import UTC, datetime, timedelta

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)

SECOND_US = 1_000_000
DAY_US = 86_400 * SECOND_US


def now_us() -> int:
    """Now, in microseconds since 1970."""
    return time.time_ns() // 1000


def to_iso(moment_us: int) -> str:
    """`2026-11-20T08:30:00.000000Z`: of equal length, so that text sorts as time does."""
    return (_EPOCH + timedelta(microseconds=moment_us)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def from_iso(text: str) -> int:
    """Microseconds since 1970. A moment without an offset is UTC. Raises `ValueError`."""
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // _MICROSECOND


def to_datetime(moment_us: int) -> datetime:
    return _EPOCH + timedelta(microseconds=moment_us)


def new_id() -> str:
    """A random identifier of 130 bits in lower-case base 32: fit for URLs, file names and double-clicks."""
    return base64.b32encode(secrets.token_bytes(17)).decode("ascii").rstrip("=").lower()[:26]
