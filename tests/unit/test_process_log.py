"""The log file is written beside the node's loop, completely and in order."""

from __future__ import annotations

import logging
import logging.handlers
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from common.process_log import QueuedLogHandler, set_up_log


@pytest.fixture(autouse=True)
def root_logger() -> Iterator[None]:
    before, level = logging.root.handlers[:], logging.root.level
    yield
    for handler in logging.root.handlers:
        if handler not in before:
            handler.close()
    logging.root.handlers[:] = before
    logging.root.setLevel(level)


def closed_file(folder: Path) -> list[str]:
    for handler in logging.root.handlers:
        if isinstance(handler, QueuedLogHandler):
            handler.close()
    return (folder / "planner.log").read_text(encoding="utf-8").splitlines()


def test_a_disk_that_takes_nothing_does_not_hold_who_logs_and_no_line_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = threading.Event()
    write = logging.handlers.RotatingFileHandler.emit

    def stalled(self: logging.handlers.RotatingFileHandler, record: logging.LogRecord) -> None:
        disk.wait(10.0)
        write(self, record)

    monkeypatch.setattr(logging.handlers.RotatingFileHandler, "emit", stalled)
    set_up_log("planner", ("planner",), tmp_path, to_terminal=False)
    for number in range(100):
        logging.getLogger("planner").info("line number=%d", number)
    assert not disk.is_set()
    disk.set()
    assert [line.rsplit("=", 1)[1] for line in closed_file(tmp_path)] == [str(number) for number in range(100)]


def test_a_line_bears_the_time_it_was_said_at_and_an_error_its_cause(tmp_path: Path) -> None:
    set_up_log("planner", ("planner",), tmp_path, to_terminal=False)
    try:
        raise ValueError("no way")
    except ValueError as error:
        logging.getLogger("planner").error("cannot go on", exc_info=error)
    first, *rest = closed_file(tmp_path)
    assert first.endswith("ERROR planner cannot go on")
    assert float(first.split()[0]) > 0.0
    assert rest[-1] == "ValueError: no way"


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        set_up_log("planner", ("planner",), tmp_path / "file" / "logs", to_terminal=False)


def test_the_journal_takes_the_place_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = os.fstat(2)
    monkeypatch.setenv("JOURNAL_STREAM", f"{stream.st_dev}:{stream.st_ino}")
    set_up_log("planner", ("planner",), tmp_path, to_terminal=True)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_written_where_stderr_is_another_than_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    set_up_log("planner", ("planner",), tmp_path, to_terminal=True)
    assert [file.name for file in tmp_path.iterdir()] == ["planner.log"]
