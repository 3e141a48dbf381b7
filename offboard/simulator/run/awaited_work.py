"""Work beside the nodes of a run in lockstep, done meanwhile in a process of its own, on another core.

The outcome of a job comes after a fixed simulated time and is waited for then, so a run repeats to the bit, whichever
of the two is faster: the same run as with a `DeferredWorker`, which does the work in the thread of the nodes.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import inf
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from common.errors import StartError
from common.side_work import JobOutcome, Work
from offboard.simulator.stopwatch import BESIDE, Stopwatch

J = TypeVar("J")
R = TypeVar("R")

_END = b""  # in place of a job
_END_S = 2.0  # for a process that has nothing to do any more
# What a run needs is loaded by then; a program that begins anew would load it once more for every worker
_PROCESSES = multiprocessing.get_context("fork")


class WorkFailed(StartError):
    """What does the jobs has failed; its own output has the reason."""


class AwaitedWorker(Generic[J, R]):
    """A `SideWorker`. Jobs and results are pickled; what a job raises ends the run.

    To be made before this process has threads, a graphics context or the like, which no copy of it could use.
    """

    ready = True

    def __init__(self, stopwatch: Stopwatch, latency_s: float, load: Callable[[], Work[J, R]]) -> None:
        """`load` is called there, at once. Waiting for a result is on an account of its own."""
        self._stopwatch, self._latency_s = stopwatch, latency_s
        self._due_s: deque[float] = deque()
        self._connection, there = multiprocessing.Pipe()
        self._process = _PROCESSES.Process(target=_serve, args=(load, there, self._connection), daemon=True)
        self._process.start()
        there.close()

    @property
    def pending(self) -> int:
        return len(self._due_s)

    @property
    def busy(self) -> bool:
        return bool(self._due_s)

    def begin(self, job: J, now_s: float) -> None:
        self._due_s.append(now_s + self._latency_s)
        try:
            self._connection.send_bytes(pickle.dumps(job, pickle.HIGHEST_PROTOCOL))
        except OSError as error:
            raise self._failed() from error

    def result(self, now_s: float) -> JobOutcome[R] | None:
        if not self._due_s or now_s < self._due_s[0]:
            return None
        return JobOutcome(self._next())

    def due_s(self, now_s: float) -> float:
        return max(self._due_s[0], now_s) if self._due_s else inf

    def close(self) -> JobOutcome[R] | None:
        """Also where the process is gone: then there is no outcome."""
        outcome: JobOutcome[R] | None = None
        with suppress(WorkFailed):
            outcome = JobOutcome(self._next()) if self._due_s else None
        with suppress(OSError):
            self._connection.send_bytes(_END)
        self._connection.close()
        self._process.join(_END_S)
        self._process.kill()
        return outcome

    def _next(self) -> R:
        """The result of the oldest job, as soon as it is there."""
        before = self._stopwatch.enter(BESIDE)
        try:
            data = self._connection.recv_bytes()
        except (OSError, EOFError) as error:
            raise self._failed() from error
        finally:
            self._stopwatch.enter(before)
        self._due_s.popleft()
        result: R = pickle.loads(data)  # from this program's other half
        return result

    def _failed(self) -> WorkFailed:
        self._process.join(_END_S)
        return WorkFailed(f"A process of the simulation has ended by itself (exit code {self._process.exitcode}).")


def _serve(load: Callable[[], Work[Any, Any]], here: Connection, parents_end: Connection) -> None:
    """The process: jobs in, results out, until the parent wants no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    parents_end.close()
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))  # else each job would interrupt the nodes on their core
    jobs: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(here, jobs), daemon=True).start()
    work = load()
    with suppress(BrokenPipeError, ConnectionResetError):
        while job := jobs.get():
            here.send_bytes(pickle.dumps(work(pickle.loads(job)), pickle.HIGHEST_PROTOCOL))


def _receive(here: Connection, jobs: queue.SimpleQueue[bytes]) -> None:
    """Jobs as they come, so that their sender never waits for the one that is done now."""
    with suppress(EOFError, OSError):
        while True:
            jobs.put(here.recv_bytes())
    jobs.put(_END)
