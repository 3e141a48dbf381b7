"""Connections of the page's server: idle ones are closed, and a flood of them does not fill the log.

uvicorn's own protocol waits without limit for a first request, a body or a slow reader, until the process has no file
descriptor left to accept another connection.
"""

from __future__ import annotations

import asyncio
import logging
import time
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from common.repeats import Repeats

CONNECTIONS_MAX = 128  # and as many that were accepted and not yet counted: far below 1024, all files of a process
PROGRESS_TIMEOUT_S = 60.0  # longer than a large picture takes over a slow link

_LOGGERS = ("uvicorn.error", "asyncio")


class BoundedProtocol(H11Protocol):
    """One connection of a browser until it becomes a page's socket, whose pings uvicorn watches."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._idle_since_s = self.loop.time()
        self._progress_check: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._expect_progress()
        if len(self.connections) > CONNECTIONS_MAX:
            idle = [other for other in self.connections if isinstance(other, BoundedProtocol) and other._is_idle]
            min(idle, key=lambda other: other._idle_since_s, default=self)._give_up()

    def connection_lost(self, exc: Exception | None) -> None:
        self._expect_nothing()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        self._expect_nothing()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        self._idle_since_s = self.loop.time()
        super().on_response_complete()

    @property
    def _is_idle(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    def _expect_progress(self) -> None:
        self._progress_check = self.loop.call_later(PROGRESS_TIMEOUT_S, self._check_progress, self.cycle)

    def _expect_nothing(self) -> None:
        if self._progress_check is not None:
            self._progress_check.cancel()

    def _check_progress(self, before: object) -> None:
        """A connection lives by new requests: one that is neither sent nor answered to its end is given up."""
        if self.cycle is before:
            self._give_up()
        else:
            self._expect_progress()

    def _give_up(self) -> None:
        self.connections.discard(self)
        self.transport.abort()


class _Brief(logging.Filter):
    """One line for each warning or error of the server, once a second for each kind, and never a traceback."""

    def __init__(self) -> None:
        super().__init__()
        self._repeats = Repeats()

    def filter(self, record: logging.LogRecord) -> bool:
        count = self._repeats.count(f"{record.module}:{record.lineno}", time.monotonic())
        lines = record.getMessage().strip().splitlines()
        error = f" error={record.exc_info[1]!r}" if record.exc_info else ""
        record.msg, record.args = "%s%s count=%d", (lines[0] if lines else "", error, count)
        record.exc_info = record.exc_text = None
        return count > 0


_BRIEF = _Brief()


def keep_log_brief() -> None:
    """Of the server and its event loop, in all of this process."""
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(_BRIEF)
