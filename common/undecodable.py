"""Messages that nothing can be made of: counted by topic, told with every doubling."""

from __future__ import annotations

import logging
from typing import Any

from common.messages import Topic

_log = logging.getLogger(__name__)


class Undecodable:
    """Of one process; `counts` by topic."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def count(self, topic: Topic[Any], problem: str) -> None:
        count = self.counts[topic.key] = self.counts.get(topic.key, 0) + 1
        # Not each: of a sender of another version nothing else would come
        if count & (count - 1) == 0:
            _log.warning("undecodable topic=%s error=%s count=%d", topic.key, problem, count)
