"""Processor time of child processes: the clock's time says nothing while other tests share the machine."""

from __future__ import annotations

import resource
from collections.abc import Callable


def least_processor_s(run: Callable[[], object], times: int = 3) -> float:
    """The least processor time that `run`, which starts a process and waits for it, has cost its child."""
    costs = []
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run()
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        costs.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return min(costs)
