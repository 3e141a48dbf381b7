"""comm's own newest messages as the recorder receives them live. Pure.

What the other modules published, they still have when comm is killed. What comm itself published in the moments
before, and had not yet written into its outbox, would be gone: these copies are stored once the outbox shows that a new
comm runs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile

from common.recording import Known, RecordedMessage, remember

COPIES_MAX = 2048  # per topic; more than comm publishes while its rows are in transit


class LiveCopies:
    """The copies by topic, until the outbox has delivered them."""

    def __init__(self, keys: Iterable[str], delivered: Mapping[tuple[str, int], int]) -> None:
        """`delivered`: newest sequence number that the database holds, by (topic, boot id)."""
        self._copies: dict[str, deque[RecordedMessage]] = {key: deque(maxlen=COPIES_MAX) for key in keys}
        self._delivered: Known = dict(delivered)

    def keep(self, messages: Iterable[RecordedMessage]) -> list[RecordedMessage]:
        """Takes the copies; returns the messages that are none."""
        others = []
        for message in messages:
            if message.key in self._copies:
                self._copies[message.key].append(message)
            else:
                others.append(message)
        return others

    def complete(self, messages: Sequence[RecordedMessage]) -> list[RecordedMessage]:
        """What the outbox delivers, with what an earlier comm could not put into it before its own successor's."""
        completed: list[RecordedMessage] = []
        for message in messages:
            if message.key in self._copies:
                completed += self._orphans(message.key, message.boot_id)
                self._note(message)
            completed.append(message)
        for copies in self._copies.values():
            while copies and self._has(copies[0]):
                copies.popleft()
        return completed

    def _orphans(self, key: str, boot_id: int) -> list[RecordedMessage]:
        """Copies from before the first one of this boot: their comm is dead, and its outbox has sent all it had."""
        copies, orphans = self._copies[key], []
        if any(copy.boot_id == boot_id for copy in copies):
            for copy in takewhile(lambda copy: copy.boot_id != boot_id, copies):
                if not self._has(copy):
                    orphans.append(copy)
                    self._note(copy)
        return orphans

    def _has(self, message: RecordedMessage) -> bool:
        return message.sequence <= self._delivered.get((message.key, message.boot_id), 0)

    def _note(self, message: RecordedMessage) -> None:
        source = (message.key, message.boot_id)
        remember(self._delivered, source, max(self._delivered.get(source, 0), message.sequence))
