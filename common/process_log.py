"""A process's log: everything from INFO on into its file and onto the bus, and no node ever waits for the disk.

A card or a disk may take seconds for a write; a loop that waited for it would stop the robot.
"""

from __future__ import annotations

import logging
import logging.handlers
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue

from common.bus import Bus
from common.messages import LOG, LogLine

_FILE_BYTES = 2_000_000
_FILES_KEPT = 2  # besides the newest
_LINES_FOR_BUS = 200


class BusLogHandler(logging.Handler):
    """Keeps log records for the nodes' own threads to publish as `LOG[module]`.

    A record belongs to the module whose thread wrote it; what other threads write, to the first one.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        super().__init__(logging.INFO)
        self._records: dict[str, deque[tuple[str, str]]] = {name: deque(maxlen=_LINES_FOR_BUS) for name in modules}
        self._others = self._records[modules[0]]

    def emit(self, record: logging.LogRecord) -> None:
        self._records.get(record.threadName or "", self._others).append((record.levelname, record.getMessage()))

    def flush_to(self, bus: Bus, module: str, now_s: float) -> None:
        records = self._records[module]
        while records:
            level, text = records.popleft()
            bus.publish(LOG[module], LogLine(now_s, level, text))


class FileLogHandler(logging.handlers.QueueHandler):
    """Lines into `name`.log in `folder`, from a thread of its own; closing waits for the last one.

    Raises OSError when the file cannot be opened.
    """

    def __init__(self, folder: Path, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        lines: SimpleQueue[logging.LogRecord] = SimpleQueue()
        file = logging.handlers.RotatingFileHandler(
            folder / f"{name}.log", maxBytes=_FILE_BYTES, backupCount=_FILES_KEPT
        )
        super().__init__(lines)
        self._writer: logging.handlers.QueueListener | None = logging.handlers.QueueListener(lines, file)
        self._writer.start()

    def close(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.stop()
        super().close()


def set_up_log(name: str, modules: Sequence[str], folder: Path | None, *, to_terminal: bool) -> BusLogHandler:
    """Everything from INFO on into the file (or to stderr without a folder) and to the bus; raises OSError."""
    handler: logging.Handler = logging.StreamHandler() if to_terminal else logging.NullHandler()
    if folder is not None:
        handler = FileLogHandler(folder, name)
    handler.setFormatter(_MonotonicFormatter("%(monotonic)s %(levelname)s %(name)s %(message)s"))
    bus_log = BusLogHandler(modules)
    logging.basicConfig(level=logging.INFO, handlers=[handler, bus_log], force=True)
    return bus_log


class _MonotonicFormatter(logging.Formatter):
    """Stamps with the monotonic clock: a board without a clock battery jumps in wall time."""

    def format(self, record: logging.LogRecord) -> str:
        record.monotonic = f"{time.monotonic():.3f}"
        return super().format(record)
