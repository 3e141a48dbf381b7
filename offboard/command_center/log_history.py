"""What was logged before this program was started, from the run database: it may be started at any time."""

from __future__ import annotations

import logging
from pathlib import Path

from common.codec import as_text
from common.errors import StartError, sentence
from common.messages.health import LogLine
from common.messages.topics import LOG
from offboard.command_center.log_book import LogEntry
from offboard.runs.run_database import Message, RunReader
from offboard.runs.run_folder import DATABASE_NAME

LINES_MAX = 2_000
ROWS_MAX = 200_000  # of the run's end that are searched for them: half an hour of all messages

_log = logging.getLogger("command_center")


def logged_before(run_dir: Path, now_s: float, wall_s: float) -> list[LogEntry]:
    """The newest lines, oldest first, as if they had arrived then on the clock that shows `now_s` at `wall_s` (s since
    1970); none where there is no database that can be read.
    """
    if not (run_dir / DATABASE_NAME).exists():
        return []
    try:
        with RunReader(run_dir) as run:
            newest, lasted_s = run.newest_row()
            lines = list(run.messages(*LOG.values(), after_row=max(0, newest - ROWS_MAX)))[-LINES_MAX:]
            dates = run.dates()
        changed_s = max(file.stat().st_mtime for file in run_dir.glob(f"{DATABASE_NAME}*"))
    except (StartError, OSError) as error:
        _log.warning("earlier log lines unknown: %s", sentence(error))
        return []
    if not lines:
        return []
    # The recorder's clock may be that of a simulation: its pace comes from the length of the run by both
    pace = (changed_s - dates[0].timestamp()) / lasted_s if dates and lasted_s > 0 else 1.0
    ended_s, last_s = now_s - (wall_s - changed_s), lines[-1].arrived_s
    return [log_entry(line, min(now_s, ended_s - max(pace, 0.0) * (last_s - line.arrived_s))) for line in lines]


def log_entry(message: Message[LogLine], arrived_s: float) -> LogEntry:
    """Of a stored line, as if it had arrived then."""
    module, line = message.topic.producer, message.payload
    return LogEntry(
        arrived_s, module, message.topic.key, line.level, as_text(module, "command_center", line), line.text
    )
