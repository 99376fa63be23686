"""Many recordings at once: a few processes, results in the order of the jobs, and no batch lost to one bad file."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import Generic, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

# How far finished results may run ahead of the slowest job, so that memory does not grow with the batch.
AHEAD_PER_WORKER = 32
# What asks a batch to stop: Ctrl-C, `kill`, and a terminal that closes.
STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def run_batch(
    task: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    n_workers: int,
    on_crash: Callable[[Job, int | None], Result],
    preload: Sequence[str] = (),
) -> Generator[Result]:
    """`task(job)` for every job, in order, each result as soon as all before it are there.

    With more than one worker the task runs in processes forked from one that has imported `preload` once, so that they
    share its memory. Each worker holds one job at a time: when it dies (a crash, the kernel short of memory),
    `on_crash(job, exit_code)` stands in for that one result, and a new worker takes its place. Workers end when this
    process does, even if it is killed. A signal to stop is heeded between two results: whoever takes the results is
    never interrupted in the middle of one. Then Ctrl-C raises `KeyboardInterrupt`, the others `SystemExit` with 128
    and the signal's number. Only the main thread can run more than one worker.
    """
    if n_workers <= 1:
        yield from map(task, jobs)
        return
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    waiting = deque(enumerate(jobs))
    done: dict[int, Result] = {}
    next_index = 0
    workers: list[_Worker[Job, Result]] = []
    with _stops_noted() as stop:
        try:
            workers += (_Worker.started(context, task) for _ in range(min(n_workers, len(jobs))))
            while next_index < len(jobs):
                for worker in workers:
                    horizon = next_index + AHEAD_PER_WORKER * len(workers)
                    if worker.held is None and waiting and waiting[0][0] < horizon:
                        worker.give(*waiting.popleft())
                busy = {worker.connection: worker for worker in workers if worker.held is not None}
                ready = wait([stop, *busy])
                if stop in ready:
                    _heed(stop)
                for connection in busy.keys() & ready:
                    worker = busy[connection]
                    index, job = worker.taken()
                    try:
                        done[index] = worker.connection.recv()
                    except (EOFError, OSError):
                        done[index] = on_crash(job, worker.exit_code())
                        workers[workers.index(worker)] = _Worker.started(context, task)
                while next_index in done:
                    yield done.pop(next_index)
                    next_index += 1
        finally:
            for worker in workers:
                worker.process.kill()  # it holds nothing that anybody waits for
            for worker in workers:
                worker.process.join()
                worker.connection.close()


@contextlib.contextmanager
def _stops_noted() -> Iterator[socket.socket]:
    """A socket on which the numbers of signals to stop arrive, and can be waited for together with results.

    The usual handlers raise wherever the program happens to be, and a signal just before `wait` would not wake it.
    What is ignored, as under nohup, stays so.
    """
    heard, told = socket.socketpair()
    heard.setblocking(False)
    told.setblocking(False)
    usual = {number: signal.getsignal(number) for number in STOPS}
    earlier = signal.set_wakeup_fd(told.fileno())
    for number, handler in usual.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, _noted)
    try:
        yield heard
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(earlier)
        heard.close()
        told.close()


def _noted(number: int, frame: FrameType | None) -> None:
    """Nothing: the system has written the number to the socket by then."""


def _heed(stop: socket.socket) -> None:
    """Raise what a signal to stop means; other signals that somebody handles are told here too, and are not ours."""
    number = stop.recv(1)[0]
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    if number in STOPS:
        raise SystemExit(128 + number)


@dataclass(eq=False, slots=True)
class _Worker(Generic[Job, Result]):
    process: BaseProcess
    connection: Connection
    held: tuple[int, Job] | None = None  # the job it works on, and its place in the batch

    @classmethod
    def started(cls, context: ForkServerContext, task: Callable[[Job], Result]) -> _Worker[Job, Result]:
        """A new process, which no signal to stop reaches: those are for this one, and it ends its workers.

        The server that workers are forked from hands its signal mask on to them. multiprocessing's tracker goes first
        because it would take the mask off again.
        """
        resource_tracker.ensure_running()
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, task), daemon=True)
        usual = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, usual)
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

    def exit_code(self) -> int | None:
        """The process's exit code once it has ended, which closing its connection makes it do."""
        self.connection.close()
        self.process.join(0.5)
        self.process.kill()
        self.process.join()
        return self.process.exitcode


def _work(connection: Connection, task: Callable[[Job], Result]) -> None:
    """A worker's life: job in, result out, until the connection closes."""
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
