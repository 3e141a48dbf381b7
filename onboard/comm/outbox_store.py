"""The outbox on the disk (SQLite): rows of messages from when they were heard until the recorder has them.

A row is one MessagePack of some messages and of how many were dropped before them. What was heard of every sender is
written with the rows, in one transaction: a comm that is killed knows afterwards what it must still ask for.
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

from common.frames import Frame, Known, Losses
from common.transaction import transaction

LOAD_BYTES = 256_000  # of rows that go to the recorder together
ROW_BYTES = 64_000  # a row ends where it passes this; a single message may be longer

_SCHEMA = """
CREATE TABLE IF NOT EXISTS rows (number INTEGER PRIMARY KEY AUTOINCREMENT, data BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS state (only INTEGER PRIMARY KEY CHECK (only = 1), outbox_id INTEGER, heard BLOB);
"""

_log = logging.getLogger("comm")


@dataclass(frozen=True, slots=True)
class Rows:
    """What goes to the recorder next: packed rows from `number` on."""

    number: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Turn:
    """What the store looks like after its newest transaction; its first rows where they were asked for."""

    stored_bytes: int
    first: Rows | None


def pack_row(frames: Sequence[Frame], dropped: Losses) -> bytes:
    """One row: messages as [topic, boot id, sequence, bytes], losses as [topic, boot id, count]."""
    messages = [[f.key, f.boot_id, f.sequence, f.data] for f in frames]
    packed: bytes = msgpack.packb([messages, [[*source, count] for source, count in dropped.items()]])
    return packed


def cut_into_rows(frames: Sequence[Frame]) -> list[list[Frame]]:
    rows: list[list[Frame]] = [[]]
    size = 0
    for frame in frames:
        if rows[-1] and size + len(frame.data) > ROW_BYTES:
            rows.append([])
            size = 0
        rows[-1].append(frame)
        size += len(frame.data)
    return rows


class OutboxStore:
    """The file; for one thread at a time. `new_id` names an outbox that begins. Raises sqlite3.Error and OSError."""

    def __init__(self, file: Path | None, new_id: int | None = None) -> None:
        """None for the file: in memory, for lockstep."""
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
        self._database = sqlite3.connect(file or ":memory:", check_same_thread=False, isolation_level=None)
        # WAL with NORMAL: no commit waits for the medium, and none is torn; a power cut may cost the newest second
        for setting in ("journal_mode = WAL", "synchronous = NORMAL", "journal_size_limit = 4000000"):
            self._database.execute(f"PRAGMA {setting}")
        self._database.executescript(_SCHEMA)
        start = (1, secrets.randbits(48) if new_id is None else new_id, msgpack.packb([]))
        self._database.execute("INSERT OR IGNORE INTO state VALUES (?, ?, ?)", start)
        self.outbox_id, heard = self._database.execute("SELECT outbox_id, heard FROM state").fetchone()
        self.heard: Known = {(key, boot_id): sequence for key, boot_id, sequence in msgpack.unpackb(heard)}
        (self._stored_bytes,) = self._database.execute("SELECT total(length(data)) FROM rows").fetchone()

    def look(self) -> Turn:
        """What an earlier life left."""
        return Turn(int(self._stored_bytes), self._first())

    def turn(
        self, frames: Sequence[Frame], dropped: Losses, heard: Known, acknowledged: int, *, load: bool = False
    ) -> Turn:
        """One transaction: store what came, remove all rows before `acknowledged`; `load` what is first now."""
        stored_bytes = self._stored_bytes
        with transaction(self._database):
            gone = self._database.execute("SELECT total(length(data)) FROM rows WHERE number < ?", (acknowledged,))
            stored_bytes -= gone.fetchone()[0]
            self._database.execute("DELETE FROM rows WHERE number < ?", (acknowledged,))
            if frames or dropped:
                packed = [pack_row(row, dropped if i == 0 else {}) for i, row in enumerate(cut_into_rows(frames))]
                self._database.executemany("INSERT INTO rows (data) VALUES (?)", [(row,) for row in packed])
                stored_bytes += sum(map(len, packed))
                known = msgpack.packb([[*source, sequence] for source, sequence in heard.items()])
                self._database.execute("UPDATE state SET heard = ?", (known,))
        self._stored_bytes = stored_bytes
        return Turn(int(stored_bytes), self._first() if load else None)

    def close(self) -> None:
        self._database.close()

    def _first(self) -> Rows | None:
        rows: list[tuple[int, bytes]] = []
        size = 0
        for number, data in self._database.execute("SELECT number, data FROM rows ORDER BY number LIMIT 256"):
            if rows and size + len(data) > LOAD_BYTES:
                break
            rows.append((number, data))
            size += len(data)
        if not rows:
            return None
        return Rows(rows[0][0], msgpack.packb([list(row) for row in rows]))


def open_store(file: Path | None, new_id: int | None = None) -> OutboxStore:
    """The outbox of an earlier life, or a new one where that cannot be read; in memory where the disk refuses both."""
    for attempt in (file, file, None):
        try:
            return OutboxStore(attempt, new_id)
        except sqlite3.DatabaseError as error:
            _log.error("outbox cannot be opened file=%s error=%s", attempt, error)
            if attempt is not None and not isinstance(error, sqlite3.OperationalError):
                with suppress(OSError):
                    attempt.replace(attempt.with_suffix(".broken"))
        except OSError as error:
            _log.error("outbox cannot be opened file=%s error=%s", attempt, error)
    return OutboxStore(None, new_id)
