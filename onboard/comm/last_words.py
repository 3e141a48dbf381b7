"""The newest messages of a process that records itself: what dies with it, another process still has. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from common.frames import Frame

KEPT = 64  # per topic; more than a recorder says between two transactions


class LastWords:
    def __init__(self, keys: Iterable[str]) -> None:
        self._kept: dict[str, deque[Frame]] = {key: deque(maxlen=KEPT) for key in keys}

    def hear(self, frame: Frame) -> list[Frame]:
        """Keeps a message; when its sender has been started anew, what it had said before its end."""
        kept = self._kept[frame.key]
        orphans: list[Frame] = []
        if kept and kept[-1].boot_id != frame.boot_id:
            orphans = list(kept)
            kept.clear()
        kept.append(frame)
        return orphans
