"""Messages that cannot be decoded: counted by topic, logged with every doubling."""

from __future__ import annotations

import logging

_log = logging.getLogger(__name__)


class Undecodable:
    """Of one process; `counts` by the key of their topic."""

    def __init__(self, complaint: str = "undecodable") -> None:
        self.counts: dict[str, int] = {}
        self._complaint = complaint

    def count(self, key: str, problem: str) -> None:
        count = self.counts[key] = self.counts.get(key, 0) + 1
        # Not every one: a sender of another version would fill the log
        if count & (count - 1) == 0:
            _log.warning("%s topic=%s error=%s count=%d", self._complaint, key, problem, count)
