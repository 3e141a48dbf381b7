"""Log lines and messages as the log view keeps them: bounded, filtered, repeats collapsed. Pure."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

CAPACITY = 20_000
CHARACTERS_MAX = 5_000_000  # in all of them: a long line costs as much as many short ones
REPEAT_WINDOW_S = 10.0
MESSAGE_LEVEL = "MESSAGE"  # of what is no log line but any other message
LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR", "CRITICAL")


@dataclass(slots=True, eq=False)
class LogEntry:
    """`text` is the universal form; `count` grows where the same line came again."""

    arrived_s: float
    module: str
    topic: str
    level: str
    text: str
    message: str
    count: int = 1
    last_s: float = 0.0  # when the last repeat arrived
    number: int = 0  # in order of arrival, given by the book

    @property
    def is_message(self) -> bool:
        return self.level == MESSAGE_LEVEL


@dataclass(frozen=True, slots=True)
class LogFilter:
    """Which entries are shown. Messages have no level: those of `topics` pass; `pattern` must be a valid regex."""

    level: str = "INFO"
    module: str | None = None
    pattern: str = ""
    topics: frozenset[str] = frozenset()

    def accepts(self, entry: LogEntry) -> bool:
        if self.module is not None and entry.module != self.module:
            return False
        if entry.is_message:
            if entry.topic not in self.topics:
                return False
        elif entry.level in LEVELS and LEVELS.index(entry.level) < LEVELS.index(self.level):
            return False
        return not self.pattern or re.search(self.pattern, entry.text, re.IGNORECASE) is not None

    def describe(self) -> str:
        """The filter for the title of the view; nothing that hides lines is left out."""
        parts = [f"{self.level.lower()} and above"]
        if self.module is not None:
            parts.append(self.module)
        if self.pattern:
            parts.append(f"/{self.pattern}/")
        if self.topics:
            topics = sorted(self.topics)
            parts.append(f"messages of {topics[0]}" if len(topics) == 1 else f"messages of {len(topics)} topics")
        return " · ".join(parts)


@dataclass
class LogBook:
    """The newest CAPACITY entries, of CHARACTERS_MAX at most, and those of them that pass the filter."""

    capacity: int = CAPACITY
    filter: LogFilter = field(default_factory=LogFilter)
    shown: list[LogEntry] = field(default_factory=list)
    _all: deque[LogEntry] = field(default_factory=deque)
    _newest: dict[str, LogEntry] = field(default_factory=dict)  # by topic
    _numbered: int = 0
    _characters: int = 0

    @property
    def total(self) -> int:
        return len(self._all)

    def add(self, entries: Iterable[LogEntry]) -> int:
        """Takes new entries in; returns how many shown ones fell out at the old end."""
        for entry in entries:
            last = self._newest.get(entry.topic)
            if last is not None and self._repeats(last, entry):
                last.count += 1
                last.last_s = entry.arrived_s
                continue
            entry.last_s = entry.arrived_s
            self._numbered += 1
            entry.number = self._numbered
            self._newest[entry.topic] = entry
            self._all.append(entry)
            self._characters += len(entry.text)
            if self.filter.accepts(entry):
                self.shown.append(entry)
        while len(self._all) > self.capacity or self._characters > CHARACTERS_MAX:
            self._characters -= len(self._all.popleft().text)
        oldest = self._all[0].number if self._all else 0
        fallen = bisect_left(self.shown, oldest, key=lambda entry: entry.number)
        del self.shown[:fallen]
        return fallen

    def set_filter(self, wanted: LogFilter) -> None:
        """Raises re.error, OverflowError or RecursionError for a pattern that is none; the old filter stays then."""
        re.compile(wanted.pattern)
        self.filter = wanted
        self.shown = [entry for entry in self._all if wanted.accepts(entry)]

    @staticmethod
    def _repeats(last: LogEntry, entry: LogEntry) -> bool:
        same = (last.level, last.message) == (entry.level, entry.message)
        return same and not entry.is_message and entry.arrived_s - last.last_s <= REPEAT_WINDOW_S
