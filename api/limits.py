"""Rate limits, in memory: one serving process owns them."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

from api.problems import TooManyRequestsError

_MANY = 10_000


@dataclass(slots=True)
class _Bucket:
    tokens: float
    at_s: float


class RateLimit:
    """A token bucket for each name: `n` at once, refilled over `per_s` seconds."""

    def __init__(self, n: int, per_s: float, told: str) -> None:
        self._n = n
        self._per_token_s = per_s / n
        self._told = told
        self._buckets: dict[str, _Bucket] = {}
        self._lock = threading.Lock()

    def take(self, name: str) -> None:
        """Use up a token. Raises `TooManyRequestsError` when none is left."""
        now = time.monotonic()
        with self._lock:
            if len(self._buckets) > _MANY:
                self._forget_full(now)
            bucket = self._buckets.setdefault(name, _Bucket(float(self._n), now))
            bucket.tokens = min(float(self._n), bucket.tokens + (now - bucket.at_s) / self._per_token_s)
            bucket.at_s = now
            if bucket.tokens < 1.0:
                raise TooManyRequestsError(self._told, (1.0 - bucket.tokens) * self._per_token_s)
            bucket.tokens -= 1.0

    def give_back(self, name: str) -> None:
        """Return a token that was not used up after all."""
        with self._lock:
            if name in self._buckets:
                self._buckets[name].tokens += 1.0  # never more than there were: `take` sees to it

    def forgive(self, name: str) -> None:
        """Start afresh for a name, as after a successful login."""
        with self._lock:
            self._buckets.pop(name, None)

    def _forget_full(self, now: float) -> None:
        refill_s = self._n * self._per_token_s
        self._buckets = {name: each for name, each in self._buckets.items() if now - each.at_s < refill_s}
