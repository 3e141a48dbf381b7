"""Work on a disk beside a node's loop: one job at a time on a thread of its own, or, in lockstep, at once.

A disk may take seconds for a write. The node hands a job over, goes on, and looks for its outcome in a later step.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

DISK_ERRORS = (OSError, sqlite3.Error)
DiskError = OSError | sqlite3.Error


@dataclass(frozen=True, slots=True)
class Outcome(Generic[T]):
    """What a job returned, or why the disk refused."""

    value: T | None
    error: DiskError | None = None


class DiskWorker(Generic[T]):
    """`begin` only while not `busy`. `at_once`: for lockstep, where a run must repeat to the bit."""

    def __init__(self, name: str, *, at_once: bool = False) -> None:
        self._threads = None if at_once else ThreadPoolExecutor(1, thread_name_prefix=f"{name}-disk")
        self._running: Future[T] | None = None

    @property
    def busy(self) -> bool:
        """A job runs, or its outcome was not taken yet."""
        return self._running is not None

    def begin(self, job: Callable[[], T]) -> None:
        if self._threads is not None:
            self._running = self._threads.submit(job)
            return
        done: Future[T] = Future()
        self._running = done
        try:
            done.set_result(job())
        except DISK_ERRORS as error:
            done.set_exception(error)

    def outcome(self) -> Outcome[T] | None:
        """Of the job that is done, once; None while there is none. Raises what is no error of the disk."""
        running = self._running
        if running is None or not running.done():
            return None
        return self._taken(running)

    def close(self) -> Outcome[T] | None:
        """Waits for the job that runs; its outcome, None when there was none."""
        running = self._running
        outcome = self._taken(running) if running is not None else None
        if self._threads is not None:
            self._threads.shutdown()
        return outcome

    def _taken(self, running: Future[T]) -> Outcome[T]:
        self._running = None
        try:
            return Outcome(running.result())
        except DISK_ERRORS as error:
            return Outcome(None, error)
