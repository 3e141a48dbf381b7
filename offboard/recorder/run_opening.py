"""Opening a run, a new one or one to go on with: `run.sqlite` and the files that are made from it.

What this program cannot go on with, because it is damaged, was taken away or is of a newer program, is put aside.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

from common.database import DatabaseFiles, damaged
from common.messages.topics import LAPTOP_RECORDED, ROBOT_RECORDED
from offboard.recorder.kept_run import KeptRun
from offboard.recorder.live_copies import LiveCopies
from offboard.recorder.run_files import TOPICS_OF_FILES, RunFiles
from offboard.runs import run_folder
from offboard.runs.run_database import read_messages
from offboard.runs.run_schema import RunDatabase, RunDatabaseError, put_aside

OF_COMM = tuple(topic for topic in ROBOT_RECORDED if topic.producer == "comm")


def open_run(run_dir: Path, date: str | None, recorder_id: int, before: KeptRun | None = None) -> KeptRun:
    """`before`: the same run, whose database was lost. Raises OSError and sqlite3.Error while the disk refuses."""
    try:
        return _open(run_dir, date, recorder_id, before)
    except (RunDatabaseError, sqlite3.DatabaseError) as error:
        if not (isinstance(error, RunDatabaseError) or damaged(error)):
            raise
        lost = put_aside(DatabaseFiles(run_dir / run_folder.DATABASE_NAME), error)
    opened = _open(run_dir, date, recorder_id, before)
    opened.lost = lost
    return opened


def reopen_run(run: KeptRun, error: BaseException, date: str | None) -> KeptRun:
    """Opens the run again after an error that means that the database is lost."""
    lost = run.database.leave(error)
    opened = open_run(run.files.run_dir, date, run.database.recorder_id, run)
    opened.lost = ", ".join(filter(None, (lost, opened.lost)))
    return opened


def _open(run_dir: Path, date: str | None, recorder_id: int, before: KeptRun | None) -> KeptRun:
    database = RunDatabase(run_dir / run_folder.DATABASE_NAME, date, recorder_id)
    try:
        known = database.newest_numbers((*LAPTOP_RECORDED, *OF_COMM))
        if before is not None:
            before.files.begin_again()
            return KeptRun(database, before.files, before.copies, known)
        files = RunFiles(run_dir)
        summary = database.summary()
        after_row = summary.row if files.restore(summary.data) else 0
        messages = read_messages(database.connection, TOPICS_OF_FILES, after_row)
        files.begin(message.payload for message in messages)
        copies = LiveCopies((topic.key for topic in OF_COMM), database.newest_numbers(OF_COMM))
        return KeptRun(database, files, copies, known)
    except BaseException:
        database.close()
        raise
