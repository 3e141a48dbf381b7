"""The tables of `run.sqlite` and how the recorder fills them: every message once by (topic, boot id, sequence).

Reading is `run_database.RunReader`. What is known of the messages as a whole (`senders`, `recorder`) is written in one
transaction with them, so that a recorder goes on with a run of any length without reading it.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.codec import DecodeError, decode
from common.database import Connection, DatabaseFiles, damaged, transaction
from common.errors import StartError
from common.messages.topics import TOPICS, Topic
from common.recording import KNOWN_BOOTS, Known, Losses, RecordedMessage

SCHEMA_VERSION = 2

_MESSAGES = """
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
CREATE TABLE starts (number INTEGER PRIMARY KEY, date TEXT NOT NULL, arrived_s REAL);  -- of the recorder
"""
_SENDERS = """
CREATE TABLE senders (         -- what is known to have been published since this run began
    topic TEXT NOT NULL,
    boot_id INTEGER NOT NULL,
    first INTEGER NOT NULL,    -- sequence numbers
    newest INTEGER NOT NULL,
    stored INTEGER NOT NULL,   -- how many of them are in `messages`
    PRIMARY KEY (topic, boot_id)
);
CREATE TABLE recorder (        -- one row
    recorder_id INTEGER NOT NULL,
    files_row INTEGER NOT NULL, -- the files of the run folder were made from the messages up to this row,
    files BLOB NOT NULL         -- and this is what it takes to go on with them (run_files.py)
);
"""
_DROPPED = """
CREATE VIEW dropped AS         -- what never came, because an outbox was over its limit or a producer was gone
    SELECT topic, boot_id, newest - first + 1 - stored AS count FROM senders WHERE newest - first + 1 > stored;
"""
# Version 1 counted what was dropped in a table, and what was stored not at all
_FROM_VERSION_1 = """
INSERT INTO senders
    SELECT topic, boot_id, min(sequence), max(sequence), count(*) FROM messages
    GROUP BY topic, boot_id ORDER BY max(row);
INSERT INTO senders SELECT topic, boot_id, 1, count, 0 FROM dropped WHERE true
    ON CONFLICT (topic, boot_id) DO UPDATE SET newest = max(newest, first - 1 + stored + excluded.newest);
DROP TABLE dropped;
DROP TABLE outboxes;
"""
_INSERT = (
    "INSERT OR IGNORE INTO messages (topic, boot_id, sequence, t_s, arrived_s, payload, problem)"
    " VALUES (?, ?, ?, ?, ?, ?, ?)"
)
_COUNT_SENDER = (
    "INSERT INTO senders VALUES (?, ?, ?, ?, ?) ON CONFLICT (topic, boot_id) DO UPDATE SET"
    " first = min(first, excluded.first), newest = max(newest, excluded.newest), stored = stored + excluded.stored"
)

TOPIC_OF_KEY: Mapping[str, Topic[Any]] = {topic.key: topic for topic in TOPICS}

_Checked = tuple[RecordedMessage, Any, str | None]  # with its payload, or the problem with it

_log = logging.getLogger("recorder")


class RunDatabaseError(StartError):
    """The file is no run database that this program can use; the message is one sentence with the reason."""


@dataclass(frozen=True, slots=True)
class Stored:
    """A sound message that is new in the database."""

    topic: Topic[Any]
    boot_id: int
    payload: Any


@dataclass(frozen=True, slots=True)
class Summary:
    """Of the files that were made from the messages up to `row`; no `data` where there is none yet."""

    row: int
    data: bytes


@dataclass(slots=True)
class Delivery:
    """What is to be stored in one transaction."""

    arrived_s: float
    messages: list[RecordedMessage] = field(default_factory=list)
    dropped: Losses = field(default_factory=dict)
    summary: Summary | None = None


@dataclass(slots=True)
class Result:
    """What became of a delivery."""

    stored: list[Stored] = field(default_factory=list)
    problems: dict[str, str] = field(default_factory=dict)  # topic -> newest problem
    row: int = 0  # the newest in the database


def validate_data(message: RecordedMessage) -> tuple[Any, str | None]:
    """The payload of a message and None, or None and the problem with it."""
    topic = TOPIC_OF_KEY.get(message.key)
    if topic is None:
        return None, "no topic of this name"
    try:
        return decode(message.data, topic.payload).payload, None
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


def put_aside(files: DatabaseFiles, error: BaseException) -> str:
    """Makes way for another database; the sentence for a person. Raises OSError."""
    kept = ", ".join(path.name for path in files.put_aside())
    sentence = f"{str(error).rstrip('.')}: the run goes on in another database"
    return f"{sentence}, what is left of this one is kept as {kept}" if kept else sentence


class RunDatabase:
    """The database of one run, for its recorder; one thread at a time. Raises sqlite3.Error, OSError."""

    def __init__(self, file: Path, date: str | None, recorder_id: int) -> None:
        """`date`: wall time of this start; None in lockstep, where a run must repeat to the bit, as does its recorder.

        Raises RunDatabaseError where this program cannot go on with what the file holds.
        """
        file.parent.mkdir(parents=True, exist_ok=True)
        self.connection = sqlite3.connect(file, check_same_thread=False, isolation_level=None, factory=Connection)
        try:
            version = check_version(self.connection, file)
            # What is acknowledged must outlive a power cut; a run in lockstep can be had again
            synchronous = "NORMAL" if date is None else "FULL"
            for setting in ("journal_mode = WAL", f"synchronous = {synchronous}", "journal_size_limit = 16000000"):
                self.connection.execute(f"PRAGMA {setting}")
            if version < SCHEMA_VERSION:
                self._bring_up_to_date(version, recorder_id)
            if date is not None:
                self.connection.execute("INSERT INTO starts (date) VALUES (?)", (date,))
            (self.recorder_id,) = self.connection.execute("SELECT recorder_id FROM recorder").fetchone()
        except BaseException:
            self.connection.close()
            raise
        self._files = DatabaseFiles(file)

    def newest_numbers(self, topics: Iterable[Topic[Any]]) -> Known:
        """Newest sequence number by (topic, boot id), of the last KNOWN_BOOTS senders of each of these topics."""
        known: Known = {}
        query = "SELECT boot_id, newest FROM senders WHERE topic = ? ORDER BY rowid DESC LIMIT ?"
        for topic in topics:
            rows = self.connection.execute(query, (topic.key, KNOWN_BOOTS)).fetchall()
            known |= {(topic.key, boot_id): newest for boot_id, newest in reversed(rows)}
        return known

    def store_data(self, delivery: Delivery) -> Result:
        """Validate and store, all or nothing; what is there already stays as it is.

        Raises DatabaseMovedError when the file is no longer the one that others find: then nothing counts as stored.
        """
        result = Result()
        with transaction(self.connection):
            self._store_messages(delivery.messages, delivery.arrived_s, result)
            losses = [(*source, first, last, 0) for source, (first, last) in delivery.dropped.items()]
            self.connection.executemany(_COUNT_SENDER, losses)
            if delivery.summary is not None:
                kept = (delivery.summary.row, delivery.summary.data)
                self.connection.execute("UPDATE recorder SET files_row = ?, files = ?", kept)
            result.row = self._newest_row()
            self._files.check()
        self._files.check()
        return result

    def summary(self) -> Summary:
        return Summary(*self.connection.execute("SELECT files_row, files FROM recorder").fetchone())

    def leave(self, error: BaseException) -> str:
        """Closes it because of such an error; returns a sentence on what became of the file. Raises OSError."""
        lost = self._files.replaced or damaged(error)
        self.close()
        return put_aside(self._files, error) if lost else ""

    def close(self) -> None:
        with suppress(sqlite3.Error):
            self.connection.close()

    def _bring_up_to_date(self, version: int, recorder_id: int) -> None:
        tables = _MESSAGES + _SENDERS if version == 0 else _SENDERS + _FROM_VERSION_1
        begin = f"INSERT INTO recorder VALUES ({recorder_id}, 0, x'');PRAGMA user_version = {SCHEMA_VERSION};"
        self.connection.executescript(f"BEGIN;{tables}{_DROPPED}{begin}COMMIT;")

    def _newest_row(self) -> int:
        row: int = self.connection.execute("SELECT coalesce(max(row), 0) FROM messages").fetchone()[0]
        return row

    def _store_messages(self, messages: Sequence[RecordedMessage], arrived_s: float, result: Result) -> None:
        """One statement for all of them, and one for each sender: a hundred messages a second come."""
        checked = [(message, *validate_data(message)) for message in messages]
        senders: dict[tuple[str, int], tuple[int, int, int]] = {}
        for message, payload, problem in self._insert(checked, arrived_s):
            source, sequence = (message.key, message.boot_id), message.sequence
            first, newest, stored = senders.get(source, (sequence, sequence, 0))
            senders[source] = min(first, sequence), max(newest, sequence), stored + 1
            if problem is None:
                result.stored.append(Stored(TOPIC_OF_KEY[message.key], message.boot_id, payload))
            else:
                result.problems[message.key] = problem
        self.connection.executemany(_COUNT_SENDER, [(*source, *counts) for source, counts in senders.items()])

    def _insert(self, checked: Sequence[_Checked], arrived_s: float) -> Sequence[_Checked]:
        """Those that were not there yet."""
        before = self._newest_row()
        rows = [
            (of.key, of.boot_id, of.sequence, None if payload is None else payload.t_s, arrived_s, of.data, problem)
            for of, payload, problem in checked
        ]
        if self.connection.executemany(_INSERT, rows).rowcount == len(rows):
            return checked
        query = "SELECT topic, boot_id, sequence FROM messages WHERE row > ?"
        new = dict.fromkeys(self.connection.execute(query, (before,)))
        # Each once: of two that are the same only the first was inserted
        return [one for one in checked if new.pop((one[0].key, one[0].boot_id, one[0].sequence), one) is None]
