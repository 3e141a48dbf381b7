"""`side_work` in a process of its own, of the lowest priority: jobs on its stdin -> results on its stdout.

It holds whatever state its work has, and loads libraries that the node's process does without. It ends with its
parent, whose end closes stdin.

    python -m common.side_process MODULE:FUNCTION [ARGUMENT...]

The function takes the arguments and returns what does a job.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from math import inf
from typing import IO, Any, Generic, TypeVar

from common.environment import PROCESS_ENVIRONMENT
from common.memory import give_back
from common.priority import come_last
from common.side_work import LOOK_S, JobOutcome, WorkLost

J = TypeVar("J")
R = TypeVar("R")

RESTART_S = 1.0  # after a process has ended by itself
CLOSE_S = 2.0  # for the job that runs; then its process is killed
_LENGTH = struct.Struct("<Q")

_log = logging.getLogger(__name__)


class ProcessWorker(Generic[J, R]):
    """Jobs and results are pickled. A job that raises, or whose process ends, has a `WorkLost` as its outcome; then
    another process is started, without any state.

    A thread starts the process and exchanges the messages, so that no step waits for either.
    """

    def __init__(self, name: str, load: str, *arguments: str) -> None:
        """`load` is MODULE:FUNCTION, which is not imported in this process."""
        self._name = name
        self._command = [sys.executable, "-m", __name__, load, *arguments]
        self._jobs: queue.SimpleQueue[tuple[J] | None] = queue.SimpleQueue()  # None: the end
        self._results: queue.SimpleQueue[JobOutcome[R]] = queue.SimpleQueue()
        self._pending = 0
        self._ending = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self.ready = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Of the process as it runs now, for measurements; 0 before the first is started."""
        return 0 if self._process is None else self._process.pid

    @property
    def pending(self) -> int:
        return self._pending

    @property
    def busy(self) -> bool:
        return self._pending > 0

    def begin(self, job: J, now_s: float) -> None:
        self._pending += 1
        self._jobs.put((job,))

    def result(self, now_s: float) -> JobOutcome[R] | None:
        try:
            outcome = self._results.get_nowait()
        except queue.Empty:
            return None
        self._pending -= 1
        return outcome

    def due_s(self, now_s: float) -> float:
        return now_s + LOOK_S if self._pending else inf

    def close(self) -> JobOutcome[R] | None:
        self._ending.set()
        self._jobs.put(None)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()
        return self.result(0.0)

    # The thread

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                code = self._run_process()
            except OSError as error:
                _log.error("%s cannot be started error=%s", self._name, error)
            else:
                if self._ending.is_set():
                    return
                _log.error("%s ended code=%s, started again", self._name, code)
            self._ending.wait(RESTART_S)

    def _run_process(self) -> int:
        """From its start to its end; its exit code."""
        with subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | PROCESS_ENVIRONMENT
        ) as process:
            self._process = process
            self._exchange(process)
            self.ready = False
            with contextlib.suppress(OSError):  # of what was not written to a process that is gone
                assert process.stdin is not None
                process.stdin.close()
        return process.returncode

    def _exchange(self, process: subprocess.Popen[bytes]) -> None:
        """Until the process is gone, or shall be."""
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            self.ready = _receive(process.stdout)
        except EOFError:
            return
        while (job := self._jobs.get()) is not None and not self._ending.is_set():
            try:
                _send(process.stdin, job[0])
                self._results.put(JobOutcome(_receive(process.stdout)))
            except (OSError, EOFError, pickle.UnpicklingError) as error:
                self._results.put(JobOutcome(None, WorkLost(f"{self._name} ended ({error})")))
                return
            give_back()


def _send(stream: IO[bytes], message: object) -> None:
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(_LENGTH.pack(len(data)))
    stream.write(data)
    stream.flush()


def _receive(stream: IO[bytes]) -> Any:
    """The next message. Raises EOFError when the other end is gone."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError("its pipe is closed")
    return pickle.loads(stream.read(_LENGTH.unpack(head)[0]))  # from this program's other half, over a private pipe


def _loaded(load: str, arguments: list[str]) -> Callable[[Any], Any]:
    module, _, function = load.partition(":")
    work: Callable[[Any], Any] = getattr(import_module(module), function)(*arguments)
    return work


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    come_last()
    jobs, results = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no result
    work = _loaded(sys.argv[1], sys.argv[2:])
    with contextlib.suppress(EOFError, BrokenPipeError):
        _send(results, True)  # loaded
        while True:
            _send(results, work(_receive(jobs)))
            give_back()


if __name__ == "__main__":
    main()
