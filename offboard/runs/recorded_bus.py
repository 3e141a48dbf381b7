"""The bus of a recorded run at one of its moments: to a node, what had arrived by then has just arrived.

Times count from the run's first message, by arrival at the recorder. Nothing can be published. Payloads are read and
decoded when somebody looks at them, so that a run of hours is open at once.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from math import inf
from typing import Any, TypeVar

from common.bus import QUEUE_LENGTH
from common.messages.topics import QosProfile, Topic
from common.recording import Losses, RecordedMessage
from offboard.runs.run_database import RunReader

P = TypeVar("P")
_KEPT_WHOLE = (QosProfile.EVENT, QosProfile.STATE)  # a receiver of these misses none


class RecordedBus:
    """`go_to` a moment; the first `take` of a topic begins with the run. One thread at a time.

    Raises RunDatabaseError for a file that is damaged.
    """

    def __init__(self, run: RunReader, topics: Iterable[Topic[Any]]) -> None:
        """`topics`: what there is to be received; of all others nothing ever arrives."""
        self._run = run
        keys = {topic.key for topic in topics}
        self._times_s: dict[str, list[float]] = {}  # by topic, of its messages
        self._rows: dict[str, list[int]] = {}
        self._taken: dict[str, int] = {}  # by topic: how many messages
        self._newest: dict[str, tuple[int, Any]] = {}  # by topic: the row that was decoded last, and its payload
        self.now_s, self.duration_s, self.began_s = 0.0, 0.0, 0.0
        arrivals = run.arrivals()
        if arrivals:
            self.began_s = arrivals[0][2]
        for row, key, arrived_s in arrivals:
            # A recorder that was started anew on another clock goes on where the one before ended
            self.duration_s = max(self.duration_s, arrived_s - self.began_s)
            if key not in keys:
                continue
            self._times_s.setdefault(key, []).append(self.duration_s)
            self._rows.setdefault(key, []).append(row)

    def go_to(self, at_s: float) -> None:
        """What was taken stays taken; the moment may not lie before the one that was shown."""
        self.now_s = at_s

    def begin_anew(self, at_s: float) -> None:
        """For a node that has taken nothing yet."""
        self.now_s = at_s
        self._taken.clear()

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        """Nobody receives it."""

    def latest(self, topic: Topic[P]) -> P | None:
        count = self._arrived(topic)
        if not count:
            return None
        row = self._rows[topic.key][count - 1]
        if self._newest.get(topic.key, (0, None))[0] != row:
            message = self._run.message(row)
            self._newest[topic.key] = row, None if message is None else message.payload
        newest: P | None = self._newest[topic.key][1]
        return newest

    def take(self, topic: Topic[P]) -> list[P]:
        begin, end = self._taken.get(topic.key, 0), self._arrived(topic)
        self._taken[topic.key] = end
        if topic.qos not in _KEPT_WHOLE:
            begin = max(begin, end - QUEUE_LENGTH)
        messages = (self._run.message(row) for row in self._rows.get(topic.key, [])[begin:end])
        return [message.payload for message in messages if message is not None]

    def age_s(self, topic: Topic[Any]) -> float:
        count = self._arrived(topic)
        return self.now_s - self._times_s[topic.key][count - 1] if count else inf

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        """Recorded it is already."""

    def take_recorded(self) -> list[RecordedMessage]:
        return []

    def take_lost(self) -> Losses:
        return {}

    def _arrived(self, topic: Topic[Any]) -> int:
        """How many messages of a topic had arrived."""
        return bisect_right(self._times_s.get(topic.key, []), self.now_s)
