"""Work beside the nodes of a run in lockstep, done meanwhile in a process of its own, on another core.

The outcome of a job comes after a fixed simulated time and is waited for then, so a run repeats to the bit, whichever
of the two is faster: the same run as with a `DeferredWorker`, which does the work in the thread of the nodes.

    python -m offboard.simulator.run.awaited_work DESCRIPTOR MODULE:FUNCTION [ARGUMENT...]

The function takes the arguments and returns what does a job (as those of `common.side_process`).
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from math import inf
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from common.environment import PROCESS_ENVIRONMENT
from common.errors import StartError
from common.memory import keep_what_is_there
from common.side_work import JobOutcome
from offboard.simulator.stopwatch import BESIDE, Stopwatch

J = TypeVar("J")
R = TypeVar("R")

_END_S = 2.0  # for a process that has nothing to do any more


class WorkFailed(StartError):
    """What does the jobs of this name has failed; its own log has the reason."""


class AwaitedWorker(Generic[J, R]):
    """A `SideWorker`. Jobs and results are pickled; what a job raises ends the run."""

    ready = True

    def __init__(self, stopwatch: Stopwatch, latency_s: float, load: str, *arguments: str) -> None:
        """`load` is MODULE:FUNCTION; waiting for a result is on an account of its own."""
        self._stopwatch, self._latency_s, self._load = stopwatch, latency_s, load
        self._due_s: deque[float] = deque()
        here, there = socket.socketpair()
        with there:
            command = [sys.executable, "-m", __name__, str(there.fileno()), load, *arguments]
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, pass_fds=(there.fileno(),), env=os.environ | PROCESS_ENVIRONMENT
            )
        self._connection = Connection(here.detach())

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
        self._connection.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
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
        return WorkFailed(f"the process of {self._load} has ended (exit code {self._process.poll()})")


def _received(connection: Connection, jobs: queue.SimpleQueue[bytes | None]) -> None:
    """Jobs as they come, so that their sender never waits for the one that is done now; None at the end."""
    with suppress(EOFError, OSError):
        while True:
            jobs.put(connection.recv_bytes())
    jobs.put(None)


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    connection = Connection(int(sys.argv[1]))
    jobs: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    threading.Thread(target=_received, args=(connection, jobs), daemon=True).start()
    module, _, function = sys.argv[2].partition(":")
    work: Callable[[Any], Any] = getattr(import_module(module), function)(*sys.argv[3:])
    keep_what_is_there()
    with suppress(BrokenPipeError, ConnectionResetError):  # a parent that wants no results any more
        while (job := jobs.get()) is not None:
            connection.send_bytes(pickle.dumps(work(pickle.loads(job)), pickle.HIGHEST_PROTOCOL))


if __name__ == "__main__":
    main()
