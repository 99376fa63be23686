"""Moments and identifiers: microseconds since 1970 inside, ISO 8601 in UTC outside."""

from __future__ import annotations

import base64
import secrets
import time
from datetime import UTC, datetime, timedelta

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_FIRST_US = (datetime(1, 1, 1, tzinfo=UTC) - _EPOCH) // _MICROSECOND
_LAST_US = (datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC) - _EPOCH) // _MICROSECOND
# A device's or a server's clock may be wrong by years; what is beyond these was not recorded by such sensors.
_OLDEST_RECORDING_US = (datetime(1990, 1, 1, tzinfo=UTC) - _EPOCH) // _MICROSECOND
_LAST_RECORDING_US = (datetime(2100, 1, 1, tzinfo=UTC) - _EPOCH) // _MICROSECOND

SECOND_US = 1_000_000
DAY_US = 86_400 * SECOND_US


def now_us() -> int:
    """Now, in microseconds since 1970."""
    return time.time_ns() // 1000


def to_iso(moment_us: int) -> str:
    """`2026-11-20T08:30:00.000000Z`: of equal length, so that text sorts as time does."""
    return to_datetime(moment_us).isoformat(timespec="microseconds").replace("+00:00", "Z")


def from_datetime(moment: datetime) -> int:
    """Microseconds since 1970. A moment without an offset is UTC."""
    return (moment.replace(tzinfo=moment.tzinfo or UTC) - _EPOCH) // _MICROSECOND


def recorded(text: str) -> int:
    """When something was recorded, in microseconds since 1970. Raises `ValueError`, also when that cannot be."""
    found = from_datetime(datetime.fromisoformat(text))
    if not _OLDEST_RECORDING_US <= found < _LAST_RECORDING_US:
        raise ValueError("not from 1990 to 2100")
    return found


def to_datetime(moment_us: int) -> datetime:
    """The moment; one beyond the calendar's ends is its end, so that whatever is stored can be read."""
    return _EPOCH + timedelta(microseconds=min(max(moment_us, _FIRST_US), _LAST_US))


def new_id() -> str:
    """A random identifier of 130 bits in lower-case base 32: fit for URLs, file names and double-clicks."""
    return base64.b32encode(secrets.token_bytes(17)).decode("ascii").rstrip("=").lower()[:26]
