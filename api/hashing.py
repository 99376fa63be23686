"""Where passwords are hashed: one thread of their own, and a short queue before it.

argon2 takes 64 MiB and a good part of a second for each. A crowd of logins must take neither the machine's memory nor
the threads that everybody else's requests run in.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from api.problems import CrowdedError

T = TypeVar("T")
_MAX_WAITING = 16
_RETRY_AFTER_S = 5.0


class Hashing:
    """Does one thing at a time, for as many as may wait."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="hashing")
        self._n_asked = 0  # by the event loop's thread alone

    async def run(self, work: Callable[[], T]) -> T:
        """What `work` gives. Raises `CrowdedError` when too many wait."""
        if self._n_asked > _MAX_WAITING:
            raise CrowdedError("Too many log in at once; try again in a moment.", _RETRY_AFTER_S)
        self._n_asked += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._executor, work)
        finally:
            self._n_asked -= 1

    def close(self) -> None:
        self._executor.shutdown(wait=False, cancel_futures=True)
