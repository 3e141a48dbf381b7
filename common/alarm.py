"""What a node's loop sleeps on: it is rung by the threads of the bus, by a signal, or by bytes at a file."""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from contextlib import suppress

_FOREVER_S = 0.25  # longest sleep: a stop that rings nothing is noticed then


class Alarm:
    """Any thread may ring it; one thread waits. `fileno` gives the file to watch too, None where there is none now."""

    def __init__(self, fileno: Callable[[], int | None] = lambda: None) -> None:
        self._fileno = fileno
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._poll = select.poll()
        self._poll.register(self._event, select.POLLIN)
        self._watched: int | None = None
        self._rung = False
        self.woke = False  # it had rung, or the file had something, at the last reset

    def ring(self) -> None:
        """Ends the wait that runs, or the next one."""
        if not self._rung:
            self._rung = True
            with suppress(OSError):  # closed: nobody waits any more
                os.eventfd_write(self._event, 1)

    def wait(self, timeout_s: float) -> bool:
        """At most so long; True when it was rung or the file has something, also since the last `reset`."""
        if self._rung:
            return True
        self._watch(self._fileno())
        for file, _ in self._poll.poll(1000.0 * min(max(timeout_s, 0.0), _FOREVER_S)):
            if file == self._watched:
                self._rung = True
        return self._rung

    def reset(self) -> None:
        """To be called before what has rung is looked at."""
        self.woke, self._rung = self._rung, False
        with suppress(BlockingIOError):
            os.eventfd_read(self._event)

    def close(self) -> None:
        os.close(self._event)

    def _watch(self, file: int | None) -> None:
        if file == self._watched:
            return
        if self._watched is not None:
            with suppress(KeyError):
                self._poll.unregister(self._watched)
        self._watched = file
        if file is not None:
            self._poll.register(file, select.POLLIN)
