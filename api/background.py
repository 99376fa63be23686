"""What runs beside the requests: sessions left unscored, files of erased sessions, webhooks, retention."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

import structlog
from starlette.concurrency import run_in_threadpool

from api import erasing, webhooks
from api.moments import DAY_US, now_us
from api.problems import ProblemError, ScoringFailedError
from api.scoring import Scorer
from api.service import Service
from api.store import chores, people, sessions

log = structlog.get_logger(__name__)

_PAUSE_S = 1.0
_TIDY_EVERY_S = 3600.0
_AT_ONCE = 16
ACTOR = "service"
_ENDED_EACH_TIME = ScoringFailedError(
    "The service ended each time it worked on this session; its recording is kept. Have it scored again by hand."
)


def resume(service: Service) -> None:
    """After a start: what was stored and not scored is due, what was to be erased goes, and no request is under way."""
    with service.store.write() as connection:
        chores.release_unfinished(connection)
        waiting = sessions.all_due(connection, service.settings.score_attempts)
        given_up = sessions.give_up(connection, service.settings.score_attempts, _ENDED_EACH_TIME.body())
    if waiting or given_up:
        log.info("unscored sessions found", count=waiting, given_up=given_up)
    erasing.finish(service)


async def run(service: Service, scorer: Scorer) -> None:
    """Until it is cancelled. Each kind of work goes its own way: a slow one holds up no other."""
    async with webhooks.Sender(service) as sender, asyncio.TaskGroup() as group:
        if service.settings.workers:
            group.create_task(_every(_PAUSE_S, lambda: _score_due(service, scorer)))
        group.create_task(_every(_PAUSE_S, sender.deliver_due))
        group.create_task(_every(_TIDY_EVERY_S, lambda: run_in_threadpool(tidy, service)))


async def _every(pause_s: float, work: Callable[[], Awaitable[None]]) -> None:
    while True:
        try:
            await work()
        except Exception:  # the next round may fare better; the requests must not suffer
            log.exception("background work failed")
        await asyncio.sleep(pause_s)


async def _score_due(service: Service, scorer: Scorer) -> None:
    def due() -> list[sessions.Session]:
        with service.store.read() as connection:
            return sessions.due(connection, _AT_ONCE)

    async def score(session: sessions.Session) -> None:
        with contextlib.suppress(ProblemError):  # noted with the session
            await scorer.score(session, ACTOR, in_background=True)

    await asyncio.gather(*(score(session) for session in await run_in_threadpool(due)))


def tidy(service: Service) -> None:
    """Drop what has run out; erase what is older than the retention says."""
    with service.store.write() as connection:
        people.drop_old_logins(connection)
        chores.drop_old_deliveries(connection)
    service.cache.trim()
    if service.settings.retention_days is not None:
        before_us = now_us() - service.settings.retention_days * DAY_US
        while True:
            with service.store.read() as connection:
                old = sessions.older_than(connection, before_us, 100)
            if not old:
                break
            for session in old:
                erasing.erase(service, session, ACTOR, reason="retention")
        log.info("retention applied", days=service.settings.retention_days)
