"""Copies of the newest messages of a process that records its own: another process has them after a crash. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from common.recording import RecordedMessage

KEPT = 64  # per topic; more than a recorder publishes between two transactions


class CrashBuffer:
    def __init__(self, keys: Iterable[str]) -> None:
        self._kept: dict[str, deque[RecordedMessage]] = {key: deque(maxlen=KEPT) for key in keys}

    def add(self, message: RecordedMessage) -> list[RecordedMessage]:
        """Keeps a message; when its sender has been started anew, what it had published before its end."""
        kept = self._kept[message.key]
        orphans: list[RecordedMessage] = []
        if kept and kept[-1].boot_id != message.boot_id:
            orphans = list(kept)
            kept.clear()
        kept.append(message)
        return orphans
