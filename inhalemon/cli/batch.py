"""Many recordings at once: a few processes, results in the order of the jobs, and no batch lost to one bad file."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

# How far finished results may run ahead of the slowest job, so that memory does not grow with the batch.
AHEAD_PER_WORKER = 32


def run_batch(
    task: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    n_workers: int,
    on_crash: Callable[[Job, int | None], Result],
    preload: Sequence[str] = (),
) -> Iterator[Result]:
    """`task(job)` for every job, in order, each result as soon as all before it are there.

    With more than one worker the task runs in processes forked from one that has imported `preload` once, so that they
    share its memory. Each worker holds one job at a time: when it dies (a crash, the kernel short of memory),
    `on_crash(job, exit_code)` stands in for that one result, and a new worker takes its place. Workers end when this
    process does, even if it is killed.
    """
    if n_workers <= 1:
        yield from map(task, jobs)
        return
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    waiting = deque(enumerate(jobs))
    done: dict[int, Result] = {}
    next_index = 0
    workers = [_Worker.started(context, task) for _ in range(min(n_workers, len(jobs)))]
    try:
        while next_index < len(jobs):
            for worker in workers:
                horizon = next_index + AHEAD_PER_WORKER * len(workers)
                if worker.held is None and waiting and waiting[0][0] < horizon:
                    worker.give(*waiting.popleft())
            busy = {worker.connection: worker for worker in workers if worker.held is not None}
            for connection in wait(list(busy)):
                worker = busy[connection]  # type: ignore[index]  # wait() is typed for sockets and handles too
                index, job = worker.taken()
                try:
                    done[index] = worker.connection.recv()
                except (EOFError, OSError):
                    done[index] = on_crash(job, worker.ended())
                    workers[workers.index(worker)] = _Worker.started(context, task)
            while next_index in done:
                yield done.pop(next_index)
                next_index += 1
    finally:
        for worker in workers:
            worker.connection.close()
        for worker in workers:
            worker.ended()


@dataclass(eq=False, slots=True)
class _Worker(Generic[Job, Result]):
    process: BaseProcess
    connection: Connection
    held: tuple[int, Job] | None = None  # the job it works on, and its place in the batch

    @classmethod
    def started(cls, context: ForkServerContext, task: Callable[[Job], Result]) -> _Worker[Job, Result]:
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, task), daemon=True)
        process.start()
        theirs.close()
        return cls(process, ours)

    def give(self, index: int, job: Job) -> None:
        self.held = index, job
        with contextlib.suppress(OSError):  # it has died between two jobs; reading its answer will tell
            self.connection.send(job)

    def taken(self) -> tuple[int, Job]:
        held, self.held = self.held, None
        assert held is not None
        return held

    def ended(self) -> int | None:
        """The process's exit code once it has ended, which closing its connection makes it do."""
        self.connection.close()
        self.process.join(0.5)
        if self.process.exitcode is None:
            self.process.terminate()
            self.process.join()
        return self.process.exitcode


def _work(connection: Connection, task: Callable[[Job], Result]) -> None:
    """A worker's life: job in, result out, until the connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then closes the connection
    try:
        while True:
            connection.send(task(connection.recv()))
    except (EOFError, OSError):
        os._exit(0)


def usable_cores() -> int:
    """How many cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
