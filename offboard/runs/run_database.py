"""Reading a run database: messages of a topic, newest of each, log and status history, points of interest.

For the recorder that goes on with a run, `runs` and `export`; also while the recorder writes, from any process.
The schema stands in `run_schema`.

    with RunReader(run_dir) as run:
        for message in run.messages(POSE):
            message.payload.x_m
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, TypeVar

from common.codec import DecodeError, as_text, decode
from common.database import Connection
from common.messages.health import LogLine, Status
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import LOG, POI, STATUS, Topic
from offboard.runs.run_folder import DATABASE_NAME
from offboard.runs.run_schema import TOPIC_OF_KEY, RunDatabaseError, check_version

P = TypeVar("P")
T = TypeVar("T")
_BUSY_S = 5.0


@dataclass(frozen=True, slots=True)
class Message(Generic[P]):
    """A stored message, decoded. `row` grows with every message that is stored: read on after the newest one seen."""

    row: int
    topic: Topic[P]
    boot_id: int
    sequence: int
    arrived_s: float
    payload: P

    def as_text(self, receiver: str) -> str:
        """The universal text form: Sender_Receiver_TimeStamp_Message."""
        return as_text(self.topic.producer, receiver, self.payload)


@dataclass(frozen=True, slots=True)
class LogEntry:
    """A stored log line; `row` as in `Message`."""

    row: int
    module: str
    line: LogLine


class RunReader:
    """Read-only, on a run folder or its `run.sqlite`. One thread at a time.

    The opening and every reading raise RunDatabaseError for a file that is damaged, or not there.
    """

    def __init__(self, run: Path) -> None:
        file = run / DATABASE_NAME if run.is_dir() else run
        if not file.is_file():
            raise RunDatabaseError(f"There is no run database at {run}: `indoor-mapping runs` lists the runs.")
        self._file = file
        try:
            self._database = sqlite3.connect(
                f"{file.resolve().as_uri()}?mode=ro",
                uri=True,
                timeout=_BUSY_S,
                check_same_thread=False,
                factory=Connection,
            )
            version = check_version(self._database, file)
        except sqlite3.OperationalError as error:
            raise RunDatabaseError(f"{file} cannot be read: {error}.") from error
        if version == 0:
            raise RunDatabaseError(f"{file} holds no run.")

    def close(self) -> None:
        self._database.close()

    def __enter__(self) -> RunReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def newest_row(self) -> tuple[int, float]:
        """Row of the newest message, and how long after the oldest one it arrived; zeros where there is none."""
        ends = "(SELECT min(row) FROM messages), (SELECT max(row) FROM messages)"
        rows = list(self._rows(f"SELECT row, arrived_s FROM messages WHERE row IN ({ends}) ORDER BY row"))
        return (int(rows[-1][0]), float(rows[-1][1]) - float(rows[0][1])) if rows else (0, 0.0)

    def messages(
        self,
        *topics: Topic[P],
        after_row: int = 0,
        since_s: float | None = None,
        until_s: float | None = None,
    ) -> Iterator[Message[P]]:
        """The sound messages of these topics as they arrived, `t_s` within [since_s, until_s]."""
        return self._readable(lambda: read_messages(self._database, topics, after_row, since_s, until_s))

    def latest(self, topic: Topic[P]) -> Message[P] | None:
        """The message of a topic that arrived last; None when there is none."""
        query = (
            "SELECT row, topic, boot_id, sequence, arrived_s, payload FROM messages"
            " WHERE topic = ? AND problem IS NULL ORDER BY row DESC LIMIT 1"
        )
        newest = [_message(*row) for row in self._rows(query, (topic.key,))]
        return newest[0] if newest else None

    def display_data(self, after_row: int = 0) -> Iterator[Message[Any]]:
        """All messages that are new since a row, for the views of the command center."""
        return self.messages(*TOPIC_OF_KEY.values(), after_row=after_row)

    def logs(
        self,
        *modules: str,
        levels: tuple[str, ...] = (),
        containing: str = "",
        limit: int | None = None,
    ) -> list[LogEntry]:
        """Log lines of these modules (of all, when none is named), oldest first; with a limit, the newest so many."""
        topics = [LOG[module] for module in modules or LOG]
        found = [
            LogEntry(message.row, message.topic.producer, message.payload)
            for message in self.messages(*topics)
            if (not levels or message.payload.level in levels) and containing.lower() in message.payload.text.lower()
        ]
        return found if limit is None else found[max(0, len(found) - limit) :]

    def statuses(self, module: str, *, changes_only: bool = False) -> Iterator[Message[Status]]:
        """The status history of a module; only where state, error code or readiness changed, where `changes_only`."""
        last: tuple[str, int, bool] | None = None
        for message in self.messages(STATUS[module]):
            current = (message.payload.state, message.payload.error_code, message.payload.ready)
            if not changes_only or current != last:
                yield message
            last = current

    def pois(self) -> list[PointOfInterest]:
        """The newest record of every point of interest, with its newest photo."""
        newest: dict[int, PointOfInterest] = {}
        for message in self.messages(POI):
            poi, old = message.payload, newest.get(message.payload.poi_id)
            if not poi.photo_jpeg and old is not None:
                poi = replace(poi, photo_jpeg=old.photo_jpeg)
            newest[poi.poi_id] = poi
        return list(newest.values())

    def arrivals(self) -> list[tuple[int, str, float]]:
        """Row, topic and time of arrival (s, on the recorder's clock) of every sound message, without its payload."""
        rows = self._rows("SELECT row, topic, arrived_s + 0.0 FROM messages WHERE problem IS NULL ORDER BY row")
        return [(row, topic, float(arrived_s or 0.0)) for row, topic, arrived_s in rows]

    def message(self, row: int) -> Message[Any] | None:
        """The one in this row; None where it cannot be decoded by this program."""
        query = "SELECT row, topic, boot_id, sequence, arrived_s, payload FROM messages WHERE row = ?"
        return next((_message(*found) for found in self._rows(query, (row,))), None)

    def counts(self) -> dict[str, int]:
        """How many messages there are of each topic, undecodable ones included."""
        return dict(self._rows("SELECT topic, count(*) FROM messages GROUP BY topic"))

    def senders(self) -> dict[tuple[str, int], tuple[int, int]]:
        """(topic, boot id) -> newest sequence number and how many messages there are."""
        query = "SELECT topic, boot_id, max(sequence), count(*) FROM messages GROUP BY topic, boot_id"
        return {(topic, boot_id): (newest, count) for topic, boot_id, newest, count in self._rows(query)}

    def dropped(self) -> dict[tuple[str, int], int]:
        """(topic, boot id) -> how many messages never came, and are known not to."""
        rows = self._rows("SELECT topic, boot_id, count FROM dropped")
        return {(topic, boot_id): count for topic, boot_id, count in rows}

    def problems(self) -> dict[str, int]:
        """Topic -> how many stored messages cannot be decoded."""
        query = "SELECT topic, count(*) FROM messages WHERE problem IS NOT NULL GROUP BY topic"
        return dict(self._rows(query))

    def dates(self) -> list[datetime]:
        """Wall times at which a recorder began or went on, with their zone; none for a run in lockstep."""
        texts = [text for (text,) in self._rows("SELECT date FROM starts ORDER BY number")]
        try:
            dates = [datetime.fromisoformat(text) for text in texts]
        except (TypeError, ValueError) as error:
            raise RunDatabaseError(f"{self._file} is damaged: table starts holds what is no date.") from error
        if any(date.tzinfo is None for date in dates):
            raise RunDatabaseError(f"{self._file} is damaged: table starts holds a date without its zone.")
        return dates

    def least_delays_s(self) -> dict[tuple[str, int], float]:
        """(topic, boot id) -> how far the recorder's clock is ahead of the sender's, the shortest delay included."""
        query = (
            "SELECT topic, boot_id, min(arrived_s - t_s) FROM messages WHERE problem IS NULL GROUP BY topic, boot_id"
        )
        # The difference is SQLite's own, so that it is a number whatever stands there
        return {(topic, boot_id): float(delay_s or 0.0) for topic, boot_id, delay_s in self._rows(query)}

    def begin_s(self) -> float:
        """When the first message arrived, on the recorder's clock."""
        ((begin_s,),) = self._rows("SELECT min(arrived_s) + 0.0 FROM messages")
        return float(begin_s or 0.0)

    def duration_s(self) -> float:
        """From the first message to the last, on the recorder's clock."""
        # The difference is SQLite's own, so that it is a number whatever stands there
        ((duration_s,),) = self._rows("SELECT max(arrived_s) - min(arrived_s) FROM messages")
        return float(duration_s or 0.0)

    def _rows(self, query: str, values: Sequence[Any] = ()) -> Iterator[tuple[Any, ...]]:
        return self._readable(lambda: self._database.execute(query, values))

    def _readable(self, rows: Callable[[], Iterable[T]]) -> Iterator[T]:
        try:
            yield from rows()
        except sqlite3.Error as error:
            raise RunDatabaseError(f"{self._file} cannot be read: {error}.") from error


def read_messages(
    database: sqlite3.Connection,
    topics: Sequence[Topic[P]],
    after_row: int = 0,
    since_s: float | None = None,
    until_s: float | None = None,
) -> Iterator[Message[P]]:
    """As `RunReader.messages`, on an open database."""
    # A query from a row on reads by rows, not by topics: the plus keeps SQLite from the index of topics
    topic = "+topic" if after_row else "topic"
    conditions = [f"{topic} IN ({', '.join('?' * len(topics))})", "row > ?", "problem IS NULL"]
    values: list[Any] = [*(topic.key for topic in topics), after_row]
    for limit, bound_s in (("t_s >= ?", since_s), ("t_s <= ?", until_s)):
        if bound_s is not None:
            conditions.append(limit)
            values.append(bound_s)
    query = (
        "SELECT row, topic, boot_id, sequence, arrived_s, payload FROM messages"
        f" WHERE {' AND '.join(conditions)} ORDER BY row"
    )
    for row in database.execute(query, values):
        message: Message[P] | None = _message(*row)
        if message is not None:
            yield message


def _message(row: int, key: str, boot_id: int, sequence: int, arrived_s: float, payload: bytes) -> Message[Any] | None:
    topic = TOPIC_OF_KEY.get(key)
    if topic is None:
        return None
    try:
        return Message(row, topic, boot_id, sequence, arrived_s, decode(payload, topic.payload).payload)
    except DecodeError:
        return None  # sound once, for a program of another version
