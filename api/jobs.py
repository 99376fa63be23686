"""A small pool of worker processes beside the event loop.

Each worker is a child of its own (`python -m api.worker`) that takes one job at a time over its pipes, so a crash or a
job past its deadline costs that job alone: the child is replaced, the others never notice. When the server dies, in
whatever way, its children read the end of their input and leave.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import orjson
import structlog

log = structlog.get_logger(__name__)

_INTERACTIVE, _BACKGROUND = 0, 1
_START_S = 60.0
_GRACE_S = 2.0
_RESPAWN_PAUSE_S = 1.0
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class SaturatedError(Exception):
    """As many jobs wait as may wait, or this one has waited for as long as one may."""


class CrashedError(Exception):
    """The worker died while it had the job."""


class DeadlineError(Exception):
    """The job took longer than it may, and its worker was ended."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a worker answered: a small JSON object and bytes that belong to it."""

    head: Mapping[str, object]
    body: bytes


@dataclass(order=True, slots=True)
class _Job:
    priority: int
    number: int
    task: Mapping[str, object] = field(compare=False)
    begun: asyncio.Event = field(compare=False)
    answer: asyncio.Future[Answer] = field(compare=False)


class Pool:
    """`size` workers and a bounded queue before them."""

    def __init__(
        self,
        size: int,
        *,
        max_waiting: int,
        deadline_s: float,
        memory_bytes: int,
        command: Sequence[str] = (sys.executable, "-m", "api.worker"),
    ) -> None:
        self.size = size
        self.deadline_s = deadline_s
        self._max_waiting = max_waiting
        self._command = (*command, str(memory_bytes))
        self._queue: asyncio.PriorityQueue[_Job] = asyncio.PriorityQueue()
        self._numbers = itertools.count()
        self._keepers: list[asyncio.Task[None]] = []
        self._children: set[asyncio.subprocess.Process] = set()
        self._n_asked = 0  # jobs under way or waiting that somebody waits for
        self.crashes = 0

    async def start(self) -> None:
        """Start the workers; jobs may be given at once and wait until the first worker is there."""
        self._keepers = [asyncio.create_task(self._keep(), name=f"worker-{n}") for n in range(self.size)]

    async def stop(self) -> None:
        """End the workers; what still waits is given up."""
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)
        while not self._queue.empty():
            self._queue.get_nowait().answer.cancel()

    @property
    def n_waiting(self) -> int:
        return self._queue.qsize()

    @property
    def pids(self) -> list[int]:
        return [child.pid for child in self._children]

    async def run(self, task: Mapping[str, object], *, in_background: bool = False) -> Answer:
        """Have a worker do `task`.

        Raises `SaturatedError` when too many wait or no worker was free before the deadline, `CrashedError` and
        `DeadlineError`. Work in the background waits for as long as it takes and lets everything else go first.
        """
        is_full = self._n_asked >= self.size + self._max_waiting
        if self.size == 0 or (is_full and not in_background):
            raise SaturatedError
        priority = _BACKGROUND if in_background else _INTERACTIVE
        answer: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        job = _Job(priority, next(self._numbers), task, asyncio.Event(), answer)
        self._queue.put_nowait(job)
        self._n_asked += not in_background
        try:
            if not in_background:
                async with asyncio.timeout(self.deadline_s):
                    await job.begun.wait()
            return await answer
        except TimeoutError as error:
            answer.cancel()
            raise SaturatedError from error
        finally:
            self._n_asked -= not in_background

    async def _keep(self) -> None:
        """Keep one worker alive and busy."""
        while True:
            child = await self._spawn()
            started_s = time.monotonic()
            try:
                if await _is_ready(child):
                    await self._feed(child)
            finally:
                await _end(child)
                self._children.discard(child)
            if time.monotonic() - started_s < _RESPAWN_PAUSE_S:
                await asyncio.sleep(_RESPAWN_PAUSE_S)  # a worker that cannot start must not fill the machine

    async def _spawn(self) -> asyncio.subprocess.Process:
        # One thread each: as many workers as cores are the parallelism, and results stay the same to the bit.
        environment = os.environ | dict.fromkeys(_THREADS, "1") | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
        child = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=environment,
            limit=2**20,
        )
        self._children.add(child)
        return child

    async def _feed(self, child: asyncio.subprocess.Process) -> None:
        """Give jobs to one worker until it is no longer usable."""
        while True:
            job = await self._queue.get()
            if job.answer.done():
                continue
            if child.stdin is None or child.stdin.is_closing():  # it died while it had nothing to do
                self._queue.put_nowait(job)
                return
            job.begun.set()
            try:
                answer = await asyncio.wait_for(_ask(child, job.task), self.deadline_s)
            except TimeoutError:
                _fail(job, DeadlineError())
                return
            except (asyncio.IncompleteReadError, ConnectionError, ValueError):
                self.crashes += 1
                _fail(job, CrashedError())
                return
            except asyncio.CancelledError:
                job.answer.cancel()
                raise
            if not job.answer.done():
                job.answer.set_result(answer)


async def _is_ready(child: asyncio.subprocess.Process) -> bool:
    """Whether the worker has loaded the library; a job's deadline does not pay for that."""
    if child.stdout is None:
        return False
    try:
        return bool(await asyncio.wait_for(child.stdout.readuntil(b"\n"), _START_S))
    except (TimeoutError, asyncio.IncompleteReadError, ConnectionError):
        log.error("worker did not start", returncode=child.returncode)
        return False


async def _ask(child: asyncio.subprocess.Process, task: Mapping[str, object]) -> Answer:
    if child.stdin is None or child.stdout is None:
        raise ConnectionError("the worker has no pipes")
    child.stdin.write(orjson.dumps(task) + b"\n")
    await child.stdin.drain()
    head = orjson.loads(await child.stdout.readuntil(b"\n"))
    return Answer(head, await child.stdout.readexactly(head.pop("n_bytes")))


def _fail(job: _Job, error: Exception) -> None:
    if not job.answer.done():
        job.answer.set_exception(error)


async def _end(child: asyncio.subprocess.Process) -> None:
    """End one worker, gently when it listens."""
    if child.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            child.send_signal(signal.SIGTERM)
        try:
            await asyncio.wait_for(child.wait(), _GRACE_S)
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
            await child.wait()
    if child.stdin is not None:
        child.stdin.close()
        with contextlib.suppress(ConnectionError):
            await child.stdin.wait_closed()
