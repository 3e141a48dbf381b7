"""Work beside a node's loop, for what takes longer than a step may: a disk, a search, a map of any size, OCR.

One mechanism in three forms. `ProcessWorker` (`side_process`) computes in a process of the lowest priority, which
may hold a state; `ThreadWorker` waits for a disk, or computes in a library that releases the interpreter;
`DeferredWorker` stands for either of them in lockstep and replay, where a run must repeat to the bit.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from math import inf
from typing import Generic, Protocol, TypeVar

J = TypeVar("J")
R = TypeVar("R")
J_in = TypeVar("J_in", contravariant=True)

Work = Callable[[J], R]  # does one job
LOOK_S = 0.03  # a result is looked for so often while a job runs

_Errors = tuple[type[Exception], ...]


class WorkLost(Exception):
    """The job was not done, and what did it has lost its state; the message is the reason. The next job is a first."""


@dataclass(frozen=True, slots=True)
class JobOutcome(Generic[R]):
    """What a job returned, or why it could not be done."""

    value: R | None
    error: Exception | None = None


class SideWorker(Protocol[J_in, R]):
    """Does jobs one after another; their outcomes come in the same order. No call but `close` waits."""

    @property
    def pending(self) -> int:
        """How many jobs were begun whose outcome was not taken yet."""

    @property
    def busy(self) -> bool:
        """Is any pending?"""

    @property
    def ready(self) -> bool:
        """Is what does the jobs loaded? Jobs may be begun before, and then wait for that."""

    def begin(self, job: J_in, now_s: float) -> None:
        """Take a job in; after those that are pending."""

    def result(self, now_s: float) -> JobOutcome[R] | None:
        """Of the oldest job, once; None while it is not done. Raises what went wrong and is no outcome."""

    def due_s(self, now_s: float) -> float:
        """When to look for a result (s, on the clock of `now_s`); infinite while nothing is pending."""

    def close(self) -> JobOutcome[R] | None:
        """Ends with the job that runs; its outcome. Those behind it are dropped."""


class DeferredWorker(Generic[J, R]):
    """In this very thread: the outcome comes after a fixed time of the messages' clock, on any machine.

    `work` does the jobs that wait. The driver of the steps may call it between them, so that no step contains them;
    otherwise they are done when their time has come.
    """

    ready = True

    def __init__(self, load: Callable[[], Work[J, R]], latency_s: float = 0.0, errors: _Errors = ()) -> None:
        """`load` is called for the first job. `errors` are outcomes, all others are raised."""
        self._load, self._latency_s, self._errors = load, latency_s, errors
        self._work: Work[J, R] | None = None
        self._jobs: deque[tuple[float, J]] = deque()
        self._done: deque[tuple[float, JobOutcome[R]]] = deque()

    @property
    def pending(self) -> int:
        return len(self._jobs) + len(self._done)

    @property
    def busy(self) -> bool:
        return self.pending > 0

    def begin(self, job: J, now_s: float) -> None:
        self._jobs.append((now_s + self._latency_s, job))

    def work(self) -> None:
        while self._jobs:
            due_s, job = self._jobs.popleft()
            self._done.append((due_s, self._outcome(job)))

    def result(self, now_s: float) -> JobOutcome[R] | None:
        if now_s < self._first_due_s():
            return None
        self.work()
        return self._done.popleft()[1]

    def due_s(self, now_s: float) -> float:
        return max(self._first_due_s(), now_s)

    def close(self) -> JobOutcome[R] | None:
        self.work()
        return self._done.popleft()[1] if self._done else None

    def _first_due_s(self) -> float:
        first = self._done or self._jobs
        return first[0][0] if first else inf

    def _outcome(self, job: J) -> JobOutcome[R]:
        if self._work is None:
            self._work = self._load()
        try:
            return JobOutcome(self._work(job))
        except self._errors as error:
            return JobOutcome(None, error)


class ThreadWorker(Generic[J, R]):
    """On a thread of this process."""

    def __init__(
        self, name: str, load: Callable[[], Work[J, R]], *, errors: _Errors = (), niceness: int | None = None
    ) -> None:
        """`load` is called on the thread, at once. `errors` are outcomes, all others are raised by `result`."""
        lower = None if niceness is None else lambda: _lower_priority(niceness)
        self._errors = errors
        self._thread = ThreadPoolExecutor(1, name, initializer=lower)
        self._work = self._thread.submit(load)
        self._running: deque[Future[R]] = deque()

    @property
    def pending(self) -> int:
        return len(self._running)

    @property
    def busy(self) -> bool:
        return bool(self._running)

    @property
    def ready(self) -> bool:
        return self._work.done()

    def begin(self, job: J, now_s: float) -> None:
        self._running.append(self._thread.submit(lambda: self._work.result()(job)))

    def result(self, now_s: float) -> JobOutcome[R] | None:
        if self._work.done():
            self._work.result()
        if not self._running or not self._running[0].done():
            return None
        return self._outcome()

    def due_s(self, now_s: float) -> float:
        return now_s + LOOK_S if self._running else inf

    def close(self) -> JobOutcome[R] | None:
        self._thread.shutdown(wait=True, cancel_futures=True)
        return self._outcome() if self._running and not self._running[0].cancelled() else None

    def _outcome(self) -> JobOutcome[R]:
        try:
            return JobOutcome(self._running.popleft().result())
        except self._errors as error:
            return JobOutcome(None, error)


def _lower_priority(niceness: int) -> None:
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), niceness)
