"""A process's log: everything from INFO on into its file and onto the bus, and no node ever waits for the disk.

A card or a disk may take seconds for a write; a loop that waited for it would stop the robot.
"""

from __future__ import annotations

import logging
import logging.handlers
import os
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue

from common.bus import Bus
from common.messages.health import LogLine
from common.messages.topics import LOG

_FILE_BYTES = 2_000_000
_FILES_KEPT = 2  # besides the newest
_LINES_FOR_BUS = 200


class BusLogHandler(logging.Handler):
    """Keeps log records for the nodes' own threads to publish as `LOG[module]`.

    A record belongs to the module that its thread works for; what other threads write, to the first one.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        super().__init__(logging.INFO)
        self._records: dict[str, deque[tuple[str, str]]] = {name: deque(maxlen=_LINES_FOR_BUS) for name in modules}
        self._first = modules[0]
        self._thread = threading.local()

    def work_for(self, module: str) -> None:
        """What this thread logs from now on is the module's."""
        self._thread.module = module

    def emit(self, record: logging.LogRecord) -> None:
        module = getattr(self._thread, "module", self._first)
        self._records[module].append((record.levelname, record.getMessage()))

    def flush_to(self, bus: Bus, module: str, now_s: float) -> None:
        records = self._records[module]
        while records:
            level, text = records.popleft()
            bus.publish(LOG[module], LogLine(now_s, level, text))


class QueuedLogHandler(logging.handlers.QueueHandler):
    """Lines to a handler that may be slow, from a thread of its own; closing waits for the last one."""

    def __init__(self, target: logging.Handler) -> None:
        lines: SimpleQueue[logging.LogRecord] = SimpleQueue()
        super().__init__(lines)
        self._writer: logging.handlers.QueueListener | None = logging.handlers.QueueListener(lines, target)
        self._writer.start()

    def close(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.stop()
        super().close()


def set_up_log(name: str, modules: Sequence[str], folder: Path | None, *, to_terminal: bool) -> BusLogHandler:
    """Everything from INFO on into the file and to the bus; to stderr without a folder, and where systemd's journal
    takes it from there. Raises OSError.
    """
    handler: logging.Handler = logging.StreamHandler() if to_terminal else logging.NullHandler()
    if _stderr_is_journal():
        handler = QueuedLogHandler(handler)
    elif folder is not None:
        handler = QueuedLogHandler(_file(folder, name))
    handler.setFormatter(_MonotonicFormatter("%(monotonic)s %(levelname)s %(name)s %(message)s"))
    bus_log = BusLogHandler(modules)
    logging.basicConfig(level=logging.INFO, handlers=[handler, bus_log], force=True)
    return bus_log


def _file(folder: Path, name: str) -> logging.Handler:
    """`name`.log in `folder`; raises OSError when it cannot be opened."""
    folder.mkdir(parents=True, exist_ok=True)
    return logging.handlers.RotatingFileHandler(folder / f"{name}.log", maxBytes=_FILE_BYTES, backupCount=_FILES_KEPT)


def _stderr_is_journal() -> bool:
    """systemd names the journal's stream to what it starts; what that starts may write elsewhere (systemd.exec(5))."""
    try:
        stream = os.fstat(2)
    except OSError:
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{stream.st_dev}:{stream.st_ino}"


class _MonotonicFormatter(logging.Formatter):
    """Stamps with the monotonic clock: a board without a clock battery jumps in wall time."""

    def format(self, record: logging.LogRecord) -> str:
        record.monotonic = f"{time.monotonic():.3f}"
        return super().format(record)
