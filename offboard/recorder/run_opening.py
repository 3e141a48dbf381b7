"""Opening a run, a new one or one to go on with: `run.sqlite` and the files that are made from it.

What this program cannot go on with, because it is damaged, was taken away or is of a newer program, is put aside.
"""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass, replace
from pathlib import Path

from common.database import DatabaseFiles, damaged
from offboard.recorder import run_folder
from offboard.recorder.run_database import read_messages
from offboard.recorder.run_files import TOPICS_OF_FILES, RunFiles
from offboard.recorder.run_schema import RunDatabase, RunDatabaseError, put_aside


@dataclass(frozen=True, slots=True)
class OpenRun:
    database: RunDatabase
    files: RunFiles
    lost: str = ""  # what became of a database that could not be gone on with


def open_run(run_dir: Path, date: str | None, recorder_id: int, files: RunFiles | None = None) -> OpenRun:
    """`files`: of the same run, whose database was lost. Raises OSError and sqlite3.Error while the disk refuses."""
    try:
        return _open(run_dir, date, recorder_id, files)
    except (RunDatabaseError, sqlite3.DatabaseError) as error:
        if not (isinstance(error, RunDatabaseError) or damaged(error)):
            raise
        lost = put_aside(DatabaseFiles(run_dir / run_folder.DATABASE_NAME), error)
    return replace(_open(run_dir, date, recorder_id, files), lost=lost)


def reopen_run(run: OpenRun, error: BaseException, date: str | None) -> OpenRun:
    """After an error that says that the database is lost."""
    lost = run.database.leave(error)
    opened = open_run(run.files.run_dir, date, run.database.recorder_id, run.files)
    return replace(opened, lost=", ".join(filter(None, (lost, opened.lost))))


def _open(run_dir: Path, date: str | None, recorder_id: int, files: RunFiles | None) -> OpenRun:
    database = RunDatabase(run_dir / run_folder.DATABASE_NAME, date, recorder_id)
    try:
        if files is not None:
            files.begin_again()
        else:
            files = RunFiles(run_dir)
            summary = database.summary()
            after_row = summary.row if files.restore(summary.data) else 0
            messages = read_messages(database.connection, TOPICS_OF_FILES, after_row)
            files.begin(message.payload for message in messages)
    except BaseException:
        database.close()
        raise
    return OpenRun(database, files)
