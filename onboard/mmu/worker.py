"""Where the back end runs: beside the steps of the mapping unit, which never waits for it.

Here a process of its own at the lowest priority; `deferred_worker` has the one for lockstep and replay. This module
loads nothing of the back end: what it needs lies in the memory of its process only.
"""

from __future__ import annotations

import contextlib
import logging
import pickle
import queue
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO, Protocol

from onboard.mmu.key_frames import Correction, Increment

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
    """The back end in `onboard.mmu.worker_process`. One that dies is started again and given everything anew."""

    def __init__(self, map_file: Path | None = None) -> None:
        self._map_file = map_file
        self._answers: queue.SimpleQueue[Correction | None] = queue.SimpleQueue()
        self._busy = False
        self._start()

    def _start(self) -> None:
        command = [
            sys.executable,
            "-m",
            "onboard.mmu.worker_process",
            *([str(self._map_file)] if self._map_file else []),
        ]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        threading.Thread(target=_listen, args=(self._process.stdout, self._answers), daemon=True).start()

    @property
    def busy(self) -> bool:
        return self._busy

    def submit(self, increment: Increment, now_s: float) -> None:
        assert self._process.stdin is not None
        self._busy = True
        with contextlib.suppress(BrokenPipeError):  # its end is told by `_listen`
            send(self._process.stdin, increment)

    def collect(self, now_s: float) -> Correction | None:
        try:
            correction = self._answers.get_nowait()
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
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def send(stream: IO[bytes], message: object) -> None:
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes]) -> object | None:
    """The next message, or None when the other end is gone."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    data = stream.read(_LENGTH.unpack(head)[0])
    message: object = pickle.loads(data)  # from this program's other half, over a private pipe
    return message


def _listen(stream: IO[bytes], answers: queue.SimpleQueue[Correction | None]) -> None:
    while True:
        try:
            message = receive(stream)
        except (OSError, ValueError, EOFError, pickle.UnpicklingError):
            message = None
        assert message is None or isinstance(message, Correction)
        answers.put(message)
        if message is None:
            return
