"""The outbox on the disk (SQLite): rows of messages from when they were received until the recorder has them.

A row is one MessagePack of some messages and of what was dropped before them. What was received of every sender is
written with the rows, in one transaction: a comm that is killed knows afterwards what it must still query.

After a power cut the file may be as it was a while before, and give the same row numbers to other messages. So numbers
and receipts count for one life of the outbox, from its opening on; a message is known by its own identity.
"""

from __future__ import annotations

import logging
import secrets
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgpack

from common.database import Connection, DatabaseFiles, damaged, transaction
from common.recording import Known, Losses, RecordedMessage

LOAD_BYTES = 256_000  # of rows that go to the recorder together
ROW_BYTES = 64_000  # a row ends where it passes this; a single message may be longer
RAM_BYTES = 64_000_000  # of an outbox that has no disk

_OPEN = 1  # as the file's user version, while a life lasts

_SCHEMA = """
CREATE TABLE IF NOT EXISTS rows (number INTEGER PRIMARY KEY AUTOINCREMENT, data BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS received (topic TEXT, boot_id INTEGER, sequence INTEGER, PRIMARY KEY (topic, boot_id));
"""

_log = logging.getLogger("comm")


@dataclass(frozen=True, slots=True)
class Rows:
    """What goes to the recorder next: packed rows from `number` on, all before `end`."""

    number: int
    end: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Turn:
    """What the store looks like after its newest transaction; its first rows where they were wanted."""

    outbox_id: int
    stored_bytes: int
    first: Rows | None
    refused: sqlite3.Error | None = None  # why nothing that came was stored


@dataclass(frozen=True, slots=True)
class Batch:
    """What one transaction stores and removes."""

    messages: Sequence[RecordedMessage]
    dropped: Losses
    received: Known
    outbox_id: int  # the life that was acknowledged
    acknowledged: int  # all rows before this number
    load: bool  # the first rows are wanted


def pack_row(messages: Sequence[RecordedMessage], dropped: Losses) -> bytes:
    """One row: messages as [topic, boot id, sequence, bytes], losses as [topic, boot id, first, last]."""
    listed = [[m.key, m.boot_id, m.sequence, m.data] for m in messages]
    packed: bytes = msgpack.packb([listed, [[*source, *span] for source, span in dropped.items()]])
    return packed


def cut_into_rows(messages: Sequence[RecordedMessage]) -> list[list[RecordedMessage]]:
    rows: list[list[RecordedMessage]] = [[]]
    size = 0
    for message in messages:
        if rows[-1] and size + len(message.data) > ROW_BYTES:
            rows.append([])
            size = 0
        rows[-1].append(message)
        size += len(message.data)
    return rows


class OutboxStore:
    """The file; for one thread at a time. `new_id` names its first life. Raises sqlite3.Error and OSError."""

    def __init__(self, file: Path | None, new_id: int | None = None) -> None:
        """None for the file: in memory, where it takes RAM_BYTES and no more."""
        self._file = file
        self._database: sqlite3.Connection | None = None
        self._open(new_id)

    @property
    def in_memory(self) -> bool:
        return self._file is None

    def look(self) -> Turn:
        """What an earlier life left."""
        return Turn(self.outbox_id, self._stored_bytes, self._first(self._database or self._open()))

    def turn(self, batch: Batch) -> Turn:
        """Stores what came, all or nothing, removes what was acknowledged, and loads what is first now.

        A file that turns out to be damaged is put aside, and another life begins with what came.
        """
        try:
            return self._turn(batch)
        except sqlite3.DatabaseError as error:
            if self._file is None or not damaged(error):
                raise
            _log.error("outbox is damaged, another begins error=%s", error)
            self.close()
            _put_aside(self._file)
        return self._turn(batch)

    def close(self) -> None:
        database, self._database = self._database, None
        if database is not None:
            with suppress(sqlite3.Error):
                database.execute("PRAGMA user_version = 0")
            with suppress(sqlite3.Error):
                database.close()

    def _open(self, new_id: int | None = None) -> sqlite3.Connection:
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
        database = sqlite3.connect(
            self._file or ":memory:", check_same_thread=False, isolation_level=None, factory=Connection
        )
        try:
            # WAL with NORMAL: no commit waits for the medium, and none is torn; a power cut costs what the system had
            # not handed to the medium, which it does within half a minute
            for setting in ("journal_mode = WAL", "synchronous = NORMAL", "journal_size_limit = 4000000"):
                database.execute(f"PRAGMA {setting}")
            if self._file is None:
                (page_bytes,) = database.execute("PRAGMA page_size").fetchone()
                database.execute(f"PRAGMA max_page_count = {RAM_BYTES // page_bytes}")
            database.executescript(_SCHEMA)
            # The last messages, if they are on no disk, cannot be counted: the log states that there may be some
            if database.execute("PRAGMA user_version").fetchone() == (_OPEN,):
                _log.warning("outbox was not closed: after a power cut, what the disk had not taken is missing")
            with suppress(sqlite3.OperationalError):  # a full disk can still be read
                database.execute(f"PRAGMA user_version = {_OPEN}")
            known = database.execute("SELECT topic, boot_id, sequence FROM received ORDER BY rowid")
            self.received: Known = {(key, boot_id): sequence for key, boot_id, sequence in known}
            (stored_bytes,) = database.execute("SELECT total(length(data)) FROM rows").fetchone()
        except sqlite3.Error:
            database.close()
            raise
        self._stored_bytes = int(stored_bytes)
        self.outbox_id = secrets.randbits(48) if new_id is None else new_id
        self._database = database
        return database

    def _turn(self, batch: Batch) -> Turn:
        database = self._database or self._open()
        same_life = batch.outbox_id == self.outbox_id
        load = batch.load or not same_life
        acknowledged = batch.acknowledged if same_life else 0
        refused: sqlite3.Error | None = None
        try:
            with transaction(database):
                removed_bytes = self._remove(database, acknowledged)
                added_bytes = self._store(database, batch.messages, batch.dropped)
                self._write_received(database, batch.received)
            self._stored_bytes += added_bytes - removed_bytes
            self.received = batch.received
        except sqlite3.Error as error:
            if damaged(error):
                raise
            refused = error
            # Where there is no space, what leaves makes some
            with suppress(sqlite3.OperationalError):
                with transaction(database):
                    removed_bytes = self._remove(database, acknowledged)
                self._stored_bytes -= removed_bytes
        return Turn(self.outbox_id, self._stored_bytes, self._first(database, acknowledged) if load else None, refused)

    def _remove(self, database: sqlite3.Connection, acknowledged: int) -> int:
        query = "SELECT total(length(data)) FROM rows WHERE number < ?"
        (removed_bytes,) = database.execute(query, (acknowledged,)).fetchone()
        database.execute("DELETE FROM rows WHERE number < ?", (acknowledged,))
        return int(removed_bytes)

    def _store(self, database: sqlite3.Connection, messages: Sequence[RecordedMessage], dropped: Losses) -> int:
        if not messages and not dropped:
            return 0
        packed = [pack_row(row, dropped if i == 0 else {}) for i, row in enumerate(cut_into_rows(messages))]
        database.executemany("INSERT INTO rows (data) VALUES (?)", [(row,) for row in packed])
        return sum(map(len, packed))

    def _write_received(self, database: sqlite3.Connection, received: Known) -> None:
        changed = [
            (*source, sequence) for source, sequence in received.items() if self.received.get(source) != sequence
        ]
        database.executemany("INSERT OR REPLACE INTO received VALUES (?, ?, ?)", changed)
        forgotten = self.received.keys() - received.keys()
        database.executemany("DELETE FROM received WHERE topic = ? AND boot_id = ?", list(forgotten))

    def _first(self, database: sqlite3.Connection, start: int = 0) -> Rows | None:
        """The first rows from a number on."""
        query = "SELECT number, data FROM rows WHERE number >= ? ORDER BY number LIMIT 256"
        rows: list[tuple[int, bytes]] = []
        size = 0
        for number, data in database.execute(query, (start,)):
            if rows and size + len(data) > LOAD_BYTES:
                break
            rows.append((number, data))
            size += len(data)
        if not rows:
            return None
        return Rows(rows[0][0], rows[-1][0] + 1, msgpack.packb([list(row) for row in rows]))


def open_store(file: Path | None, new_id: int | None = None) -> OutboxStore:
    """The outbox of an earlier life, or a new one where that cannot be read; in memory where the disk refuses both."""
    for attempt in (file, file, None):
        try:
            return OutboxStore(attempt, new_id)
        except sqlite3.DatabaseError as error:
            _log.error("outbox cannot be opened file=%s error=%s", attempt, error)
            if attempt is not None and damaged(error):
                with suppress(OSError):
                    _put_aside(attempt)
        except OSError as error:
            _log.error("outbox cannot be opened file=%s error=%s", attempt, error)
    return OutboxStore(None, new_id)


def _put_aside(file: Path) -> None:
    kept = DatabaseFiles(file).put_aside()
    _log.error("the damaged outbox is kept as %s", " ".join(map(str, kept)))
