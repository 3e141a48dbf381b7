"""What `runs` lists of a run: the floor from its beginning on, and how it ended in the words that everything has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.codec import encode
from common.messages.health import LogLine
from common.messages.mission import Outcome, PlannerView
from common.messages.stop import Permit
from common.messages.topics import LOG, PERMIT, PLAN, Topic
from common.mission_state import ENDED
from common.recording import RecordedMessage
from deploy.cli import main
from offboard.command_center.log_history import logged_before
from offboard.runs.run_list import read_run
from offboard.runs.run_schema import Delivery, RunDatabase
from offboard.simulator.run.options import RunOptions, floor_path, prepare_folder

DATE = "2026-01-02T03:04:05+00:00"
FREE = Permit(0.0, True, "", stop_epoch=1)
DRIVING = PlannerView(1.0, "ROUTE", "driving to a side hall", np.zeros((0, 2), np.float32), 3, 42.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of a simulated run that has just begun."""
    return prepare_folder(RunOptions(floor_path("straight"), out=tmp_path / "run"))


def record(folder: Path, *messages: tuple[Topic, object], arrived_s: float = 1.0) -> None:
    database = RunDatabase(folder / "run.sqlite", DATE, recorder_id=7)
    known = [
        RecordedMessage(topic.key, 1, number, encode(payload, number, 1))
        for number, (topic, payload) in enumerate(messages, 1)
    ]
    database.store_data(Delivery(arrived_s, known))
    database.close()


def test_a_run_that_goes_on_has_its_floor_and_what_it_does(folder: Path) -> None:
    record(folder, (PLAN, replace(DRIVING, paused=True)), (PERMIT, FREE))
    line = read_run(folder).as_text()
    assert ", straight, " in line
    assert "not ended: paused while driving to a side hall" in line
    assert "DAMAGED" not in line


@pytest.mark.parametrize("outcome", ENDED)
def test_each_end_has_the_words_that_page_and_terminal_show(outcome: Outcome, folder: Path) -> None:
    record(folder, (PLAN, replace(DRIVING, mode="DONE", detail=ENDED[outcome], outcome=outcome)), (PERMIT, FREE))
    line = read_run(folder).as_text()
    assert ENDED[outcome] in line
    assert ("finished" in line) is (outcome is Outcome.FINISHED)


def test_folders_without_runs_are_told_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder, words in ((tmp_path / "nope", "There is no folder"), (tmp_path, "No run in")):
        assert main(["runs", str(folder)]) == 2
        shown = capsys.readouterr()
        assert words in shown.err
        assert shown.out == ""


def test_what_was_logged_before_is_there_with_its_time_and_its_newest_line_last(folder: Path) -> None:
    record(folder, (LOG["mmu"], LogLine(1.0, "INFO", "first")), (LOG["comm"], LogLine(2.0, "WARNING", "second")))
    written_s = max(file.stat().st_mtime for file in folder.glob("run.sqlite*"))
    entries = logged_before(folder, now_s=1000.0, wall_s=written_s + 30.0)
    assert [(entry.module, entry.level, entry.message) for entry in entries] == [
        ("mmu", "INFO", "first"),
        ("comm", "WARNING", "second"),
    ]
    assert entries[-1].arrived_s == pytest.approx(970.0, abs=0.1)
    assert entries[0].text.startswith("MMU_CC_1000_INFO,first")


def test_no_database_and_a_damaged_one_leave_the_log_empty(tmp_path: Path) -> None:
    assert logged_before(tmp_path, 1.0, 1.0) == []
    (tmp_path / "run.sqlite").write_bytes(b"no database" * 1000)
    assert logged_before(tmp_path, 1.0, 1.0) == []
