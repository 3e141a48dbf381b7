"""The tables of `run.sqlite` and how the recorder fills them: every message once by (topic, boot id, sequence).

Reading is `run_database.RunReader`. A transaction holds messages together with what says that they are there
(`outboxes`), so that a recorder that was killed knows what it still wants.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.codec import DecodeError, decode
from common.errors import StartError
from common.frames import KNOWN_BOOTS, Frame, Known, Losses
from common.messages import TOPICS, Topic
from common.transaction import transaction

SCHEMA_VERSION = 1

_SCHEMA = """
CREATE TABLE messages (
    row INTEGER PRIMARY KEY,   -- in the order of arrival
    topic TEXT NOT NULL,
    boot_id INTEGER NOT NULL,  -- of the sender: new with each of its starts
    sequence INTEGER NOT NULL, -- of the sender, per topic, from 1
    t_s REAL,                  -- when its content was measured, on the sender's clock; NULL where problem
    arrived_s REAL NOT NULL,   -- on the recorder's clock
    payload BLOB NOT NULL,     -- as it travelled (common/codec.py)
    problem TEXT               -- why it cannot be decoded; NULL for a sound message
);
CREATE UNIQUE INDEX messages_once ON messages (topic, boot_id, sequence);
CREATE TABLE dropped (         -- what never came, because an outbox was over its limit or a producer was gone
    topic TEXT NOT NULL,
    boot_id INTEGER NOT NULL,
    count INTEGER NOT NULL,
    PRIMARY KEY (topic, boot_id)
);
CREATE TABLE outboxes (outbox_id INTEGER PRIMARY KEY, next_row INTEGER NOT NULL);
CREATE TABLE starts (number INTEGER PRIMARY KEY, date TEXT NOT NULL, arrived_s REAL);  -- of the recorder
"""
_INSERT = (
    "INSERT OR IGNORE INTO messages (topic, boot_id, sequence, t_s, arrived_s, payload, problem)"
    " VALUES (?, ?, ?, ?, ?, ?, ?)"
)
_ADD_DROPPED = (
    "INSERT INTO dropped VALUES (?, ?, ?) ON CONFLICT (topic, boot_id) DO UPDATE SET count = count + excluded.count"
)

TOPIC_OF_KEY: Mapping[str, Topic[Any]] = {topic.key: topic for topic in TOPICS}

_log = logging.getLogger("recorder")


class RunDatabaseError(StartError):
    """The file is no run database that this program can use: one sentence says why."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A sound message that is new in the database."""

    topic: Topic[Any]
    boot_id: int
    payload: Any


@dataclass(slots=True)
class Delivery:
    """What is to be stored in one transaction."""

    arrived_s: float
    frames: list[Frame] = field(default_factory=list)
    dropped: Losses = field(default_factory=dict)
    outbox_id: int | None = None
    next_row: int = 0


@dataclass(frozen=True, slots=True)
class Result:
    """What became of a delivery."""

    stored: list[Stored]
    problems: dict[str, str]  # topic -> newest problem


def validate_data(frame: Frame) -> tuple[Any, str | None]:
    """The payload of a message and None, or None and the problem with it."""
    topic = TOPIC_OF_KEY.get(frame.key)
    if topic is None:
        return None, "no topic of this name"
    try:
        return decode(frame.data, topic.payload).payload, None
    except DecodeError as error:
        return None, str(error)


def check_version(database: sqlite3.Connection, file: Path) -> int:
    """The schema's version, 0 for an empty file; raises RunDatabaseError for one that is not known."""
    try:
        (version,) = database.execute("PRAGMA user_version").fetchone()
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise
        raise RunDatabaseError(f"{file} is no run database: {error}.") from error
    if version > SCHEMA_VERSION:
        raise RunDatabaseError(f"{file} was written by a newer program (schema {version}): update this one.")
    return int(version)


class RunDatabase:
    """The database of one run, for its recorder; one thread at a time. Raises sqlite3.Error, OSError."""

    def __init__(self, file: Path, date: str | None) -> None:
        """`date`: wall time of this start; None in lockstep, where a run must repeat to the bit."""
        file.parent.mkdir(parents=True, exist_ok=True)
        self._database = sqlite3.connect(file, check_same_thread=False, isolation_level=None)
        for setting in ("journal_mode = WAL", "synchronous = NORMAL", "journal_size_limit = 16000000"):
            self._database.execute(f"PRAGMA {setting}")
        if check_version(self._database, file) == 0:
            self._database.executescript(f"BEGIN;{_SCHEMA}PRAGMA user_version = {SCHEMA_VERSION};COMMIT;")
        if date is not None:
            self._database.execute("INSERT INTO starts (date) VALUES (?)", (date,))

    def next_rows(self) -> dict[int, int]:
        """Outbox id -> the first row of it that is not here yet."""
        return dict(self._database.execute("SELECT outbox_id, next_row FROM outboxes"))

    def heard(self, topics: Iterable[Topic[Any]]) -> Known:
        """Newest sequence number by (topic, boot id), of the last KNOWN_BOOTS senders of each of these topics."""
        known: Known = {}
        query = (
            "SELECT boot_id, max(sequence), max(row) FROM messages WHERE topic = ?"
            " GROUP BY boot_id ORDER BY max(row) DESC LIMIT ?"
        )
        for topic in topics:
            rows = self._database.execute(query, (topic.key, KNOWN_BOOTS)).fetchall()
            known |= {(topic.key, boot_id): sequence for boot_id, sequence, _ in reversed(rows)}
        return known

    def store_data(self, delivery: Delivery) -> Result:
        """Validate and store, all or nothing; what is there already stays as it is."""
        result = Result([], {})
        with transaction(self._database):
            for frame in delivery.frames:
                self._store_frame(frame, delivery.arrived_s, result)
            losses = [(*source, count) for source, count in delivery.dropped.items()]
            self._database.executemany(_ADD_DROPPED, losses)
            if delivery.outbox_id is not None:
                reached = (delivery.outbox_id, delivery.next_row)
                self._database.execute("INSERT OR REPLACE INTO outboxes VALUES (?, ?)", reached)
        return result

    def close(self) -> None:
        self._database.close()

    def _store_frame(self, frame: Frame, arrived_s: float, result: Result) -> None:
        payload, problem = validate_data(frame)
        t_s = None if payload is None else payload.t_s
        row = (frame.key, frame.boot_id, frame.sequence, t_s, arrived_s, frame.data, problem)
        if not self._database.execute(_INSERT, row).rowcount:
            return
        if problem is None:
            result.stored.append(Stored(TOPIC_OF_KEY[frame.key], frame.boot_id, payload))
        else:
            result.problems[frame.key] = problem
