"""A recorded run through the very node that shows a live robot: plays at any speed, jumps to any moment. No clock here.

`RecordedBus` -> `CommandCenter`, stepped in the run's own time. A jump begins with a new node, since one that has seen
what comes later cannot unlearn it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.codec import as_text
from common.messages.health import LogLine
from common.messages.topics import LOG, PLAN, POI, TOPICS, Topic
from offboard.command_center.command_center import CommandCenter
from offboard.command_center.log_book import CAPACITY, MESSAGE_LEVEL, LogEntry
from offboard.command_center.log_history import log_entry
from offboard.runs.moments import Moment, moments_of
from offboard.runs.recorded_bus import RecordedBus
from offboard.runs.run_database import Message, RunReader

SPEEDS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0)
STEP_S = 0.5  # of the run, of a node that plays
RUN_IN_S = 3.0  # before the moment that is jumped to: what rates and ages are judged by
_LOGS = tuple(LOG.values())


class RunPlayer:
    """Opens at the run's end, as the page does. Raises RunDatabaseError; `close` in `finally`."""

    def __init__(self, run_dir: Path) -> None:
        self._reader = RunReader(run_dir)
        # Log lines do not go through the node: all of the run's are shown at any moment
        self._bus = RecordedBus(self._reader, (topic for topic in TOPICS if topic not in _LOGS))
        self.duration_s = self._bus.duration_s
        dates = self._reader.dates()
        self.began_wall_s = dates[0].timestamp() if dates else None
        self.speed, self.playing = 1.0, False
        lines = list(self._reader.messages(*_LOGS))
        self._lines = [log_entry(line, line.arrived_s - self._bus.began_s) for line in lines]
        self.moments = self._moments(lines)
        self.at_s = self.duration_s
        self.node = self._node()

    def close(self) -> None:
        self._reader.close()

    def play(self) -> None:
        """Or pause; from the end on, the run from its beginning."""
        self.playing = not self.playing and self.duration_s > 0.0
        if self.playing and self.at_s >= self.duration_s:
            self.jump(0.0)

    def change_speed(self, steps: int) -> None:
        self.speed = SPEEDS[min(max(SPEEDS.index(self.speed) + steps, 0), len(SPEEDS) - 1)]

    def jump(self, at_s: float) -> None:
        self.at_s = min(max(at_s, 0.0), self.duration_s)
        self.node = self._node()

    def advance(self, passed_s: float) -> None:
        """So much time has passed for whoever looks."""
        if not self.playing:
            return
        end_s = min(self.at_s + passed_s * self.speed, self.duration_s)
        while self.at_s < end_s:
            self.at_s = min(self.at_s + STEP_S, end_s)
            self._step()
        self.playing = self.at_s < self.duration_s

    def moment_beside(self, direction: int) -> Moment | None:
        """The next one after the moment that is shown, or with -1 the one before."""
        after = [moment for moment in self.moments if moment.at_s > self.at_s + 0.01]
        before = [moment for moment in self.moments if moment.at_s < self.at_s - 0.01]
        return (after[0] if after else None) if direction > 0 else (before[-1] if before else None)

    def entries(self, topics: Iterable[Topic[Any]]) -> list[LogEntry]:
        """Every log line of the run and every message of these topics, as they arrived; the newest where too many."""
        entries = [replace(line) for line in self._lines]  # a book counts repeats in them
        for topic in topics:
            for message in self._reader.messages(topic):
                text = as_text(topic.producer, CommandCenter.name, message.payload)
                at_s = message.arrived_s - self._bus.began_s
                entries.append(LogEntry(at_s, topic.producer, topic.key, MESSAGE_LEVEL, text, text))
        return sorted(entries, key=lambda entry: entry.arrived_s)[-CAPACITY:]

    def _moments(self, lines: list[Message[LogLine]]) -> list[Moment]:
        shown: list[Message[Any]] = [*self._reader.messages(PLAN), *self._reader.messages(POI)]
        return [moment for moment in moments_of(shown, lines, self._bus.began_s) if moment.at_s >= 0.0]

    def _node(self) -> CommandCenter:
        began_s = self.began_wall_s or 0.0
        self.node = CommandCenter(lambda: self.at_s, wall_clock=lambda: began_s + self.at_s)
        end_s, self.at_s = self.at_s, max(0.0, self.at_s - RUN_IN_S)
        self._bus.begin_anew(self.at_s)
        self._step()
        while self.at_s < end_s:
            self.at_s = min(self.at_s + STEP_S, end_s)
            self._step()
        return self.node

    def _step(self) -> None:
        self._bus.go_to(self.at_s)
        self.node.step(self._bus, self.at_s)
