"""What outbox and run database share: a SQLite file with whole transactions, which is put aside when it is lost.

A file is lost when it is damaged, or when it was deleted or replaced: then SQLite would go on writing into a file that
has no name any more.
"""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

_SIDES = ("", "-wal", "-shm")  # the database itself, and what stands beside it while it is open


class Connection(sqlite3.Connection):
    """For `sqlite3.connect(..., factory=Connection)`: whatever is damaged raises sqlite3.Error.

    Where the text of the schema is damaged, SQLite quotes it in its message, and Python cannot decode that.
    """

    def execute(self, *query: Any) -> sqlite3.Cursor:
        with _decoded():
            return super().execute(*query)

    def executemany(self, *query: Any) -> sqlite3.Cursor:
        with _decoded():
            return super().executemany(*query)

    def executescript(self, *query: Any) -> sqlite3.Cursor:
        with _decoded():
            return super().executescript(*query)


@contextmanager
def _decoded() -> Iterator[None]:
    try:
        yield
    except UnicodeDecodeError as error:
        corrupt = sqlite3.DatabaseError("malformed database schema")
        corrupt.sqlite_errorcode, corrupt.sqlite_errorname = sqlite3.SQLITE_CORRUPT, "SQLITE_CORRUPT"
        raise corrupt from error


class DatabaseMovedError(sqlite3.DatabaseError):
    """The file was deleted or replaced while it was open."""


class DatabaseFiles:
    """The files of a database as they are now: whether they stay where they are, and how to put them aside."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._paths = {side: file.with_name(file.name + side) for side in _SIDES}
        self._identities = {side: _identity(path) for side, path in self._paths.items()}

    def check(self) -> None:
        """Raises DatabaseMovedError when a name leads to another file than before, or to none."""
        if any(identity != _identity(self._paths[side]) for side, identity in self._identities.items()):
            raise DatabaseMovedError(f"{self._file} was deleted or replaced")

    @property
    def replaced(self) -> bool:
        """Another database, or none, stands where this one stood."""
        return self._identities[""] != _identity(self._file)

    def put_aside(self) -> list[Path]:
        """Renames those of the files that are still there; returns where a person finds them. Raises OSError."""
        free = (self._file.with_name(f"{self._file.stem}.aside-{n}{self._file.suffix}") for n in count(1))
        aside = next(path for path in free if not path.exists())
        kept = []
        for side, identity in self._identities.items():
            path = self._paths[side]
            if identity is not None and identity == _identity(path):
                kept.append(path.replace(f"{aside}{side}"))
        return kept


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    return status.st_dev, status.st_ino


def damaged(error: BaseException) -> bool:
    """The file itself is at fault; to try again would be in vain."""
    return _code(error) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def lost(error: BaseException) -> bool:
    """Only another file can help."""
    return isinstance(error, DatabaseMovedError) or damaged(error)


def disk_full(error: BaseException) -> bool:
    no_space = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    return no_space or _code(error) == sqlite3.SQLITE_FULL


def _code(error: BaseException) -> int | None:
    """SQLite's primary result code."""
    code: int | None = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


@contextmanager
def transaction(database: sqlite3.Connection) -> Iterator[None]:
    """On a connection without isolation level; what ends it takes everything back."""
    database.execute("BEGIN IMMEDIATE")
    try:
        yield
        database.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):
            database.execute("ROLLBACK")
        raise
