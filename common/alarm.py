"""What a loop sleeps on: it is rung by the threads of the bus, or by bytes at a file."""

from __future__ import annotations

import os
import select
from contextlib import suppress

_FOREVER_S = 0.25  # longest sleep: a stop that rings nothing is noticed then


class Alarm:
    """Any thread may ring it; one thread waits."""

    def __init__(self) -> None:
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._poll = select.poll()
        self._poll.register(self._event, select.POLLIN)
        self._watched: int | None = None
        self.rung = False  # since the last reset

    def ring(self) -> None:
        """Ends the wait that runs, or the next one."""
        if not self.rung:
            self.rung = True
            with suppress(OSError):  # closed: nobody waits any more
                os.eventfd_write(self._event, 1)

    def wait(self, timeout_s: float, file: int | None = None) -> bool:
        """At most so long, until it is rung or the file has something; True for the file."""
        self._watch(file)
        ready = [descriptor for descriptor, _ in self._poll.poll(1000.0 * min(max(timeout_s, 0.0), _FOREVER_S))]
        if self._event in ready:
            # Also without `rung`: who rings may have been held up before the write, and that one was answered meanwhile
            self._take()
        return file in ready

    def reset(self) -> None:
        """To be called before what has rung is looked at."""
        if self.rung:
            self.rung = False
            self._take()

    def close(self) -> None:
        os.close(self._event)

    def _take(self) -> None:
        with suppress(BlockingIOError):
            os.eventfd_read(self._event)

    def _watch(self, file: int | None) -> None:
        if file == self._watched:
            return
        if self._watched is not None:
            with suppress(KeyError):
                self._poll.unregister(self._watched)
        self._watched = file
        if file is not None:
            self._poll.register(file, select.POLLIN)
