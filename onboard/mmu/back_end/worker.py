"""Where the back end runs: beside the steps of the mapping unit, which never waits for it.

Here it is a process of its own at the lowest priority; `deferred_worker` has the one for lockstep and replay. This
module imports nothing that computes: scipy and the back end are loaded in their own process only.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import queue
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, Protocol

from common.environment import PROCESS_ENVIRONMENT
from common.memory import give_back
from onboard.mmu.back_end.exchange import Correction, Increment

_LENGTH = struct.Struct("<Q")

_log = logging.getLogger("mmu")


class Worker(Protocol):
    """Takes one increment at a time; `collect` gives its correction once it is there."""

    @property
    def busy(self) -> bool: ...

    def submit(self, increment: Increment, now_s: float) -> None: ...

    def collect(self, now_s: float) -> Correction | None: ...

    def close(self) -> None: ...


class ProcessWorker:
    """The back end in `onboard.mmu.back_end.worker_process`. One that dies is started again and given everything again.

    A thread exchanges the messages, so that no step waits for a full pipe or for a correction of a large map.
    """

    def __init__(self, map_file: Path | None = None) -> None:
        self._map_file = map_file
        self._increments: queue.SimpleQueue[Increment | None] = queue.SimpleQueue()
        self._corrections: queue.SimpleQueue[Correction | None] = queue.SimpleQueue()
        self._busy = False
        self._start()

    def _start(self) -> None:
        command = [
            sys.executable,
            "-m",
            "onboard.mmu.back_end.worker_process",
            *([str(self._map_file)] if self._map_file else []),
        ]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | PROCESS_ENVIRONMENT
        )
        threading.Thread(
            target=_exchange, args=(self._process, self._increments, self._corrections), name="back end", daemon=True
        ).start()

    @property
    def pid(self) -> int:
        """Of the process as it runs now, for measurements."""
        return self._process.pid

    @property
    def busy(self) -> bool:
        return self._busy

    def submit(self, increment: Increment, now_s: float) -> None:
        self._busy = True
        self._increments.put(increment)

    def collect(self, now_s: float) -> Correction | None:
        try:
            correction = self._corrections.get_nowait()
        except queue.Empty:
            return None
        self._busy = False
        if correction is None:
            _log.error("back end ended code=%s, started again", self._process.wait())
            self._start()
            return Correction.lost()
        return correction

    def close(self) -> None:
        assert self._process.stdin is not None
        self._increments.put(None)
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def send(stream: IO[bytes], message: object) -> None:
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(_LENGTH.pack(len(data)))
    stream.write(data)
    stream.flush()


def receive(stream: IO[bytes]) -> object | None:
    """The next message, or None when the other end is gone."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    data = stream.read(_LENGTH.unpack(head)[0])
    message: object = pickle.loads(data)  # from this program's other half, over a private pipe
    return message


def _exchange(
    process: subprocess.Popen[bytes],
    increments: queue.SimpleQueue[Increment | None],
    corrections: queue.SimpleQueue[Correction | None],
) -> None:
    """One correction for every increment; None, and the end, when the process is gone."""
    assert process.stdin is not None
    assert process.stdout is not None
    while (increment := increments.get()) is not None:
        message: object = None
        with contextlib.suppress(OSError, ValueError, EOFError, pickle.UnpicklingError):
            send(process.stdin, increment)
            message = receive(process.stdout)
        assert message is None or isinstance(message, Correction)
        corrections.put(message)
        if message is None:
            return
        give_back()
