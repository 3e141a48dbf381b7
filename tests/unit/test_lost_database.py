"""The run database is damaged, taken away or an old one: what is said is kept all the same, and the reason told."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from common.codec import encode
from common.errors import ErrorCode
from common.messages.topics import PERMIT, POI, POSE
from offboard.recorder import kept_run, recorder
from offboard.recorder.run_files import RunFiles
from offboard.runs import run_folder
from offboard.runs.run_database import RunReader
from offboard.runs.run_schema import SCHEMA_VERSION, RunDatabase
from tests.unit.damage import spoil_schema
from tests.unit.outbox_link import Link, damage, door, pose, poses_in

# Of the first version of the project
VERSION_1 = """
CREATE TABLE messages (
    row INTEGER PRIMARY KEY, topic TEXT NOT NULL, boot_id INTEGER NOT NULL, sequence INTEGER NOT NULL, t_s REAL,
    arrived_s REAL NOT NULL, payload BLOB NOT NULL, problem TEXT
);
CREATE UNIQUE INDEX messages_once ON messages (topic, boot_id, sequence);
CREATE TABLE dropped (
    topic TEXT NOT NULL, boot_id INTEGER NOT NULL, count INTEGER NOT NULL, PRIMARY KEY (topic, boot_id)
);
CREATE TABLE outboxes (outbox_id INTEGER PRIMARY KEY, next_row INTEGER NOT NULL);
CREATE TABLE starts (number INTEGER PRIMARY KEY, date TEXT NOT NULL, arrived_s REAL);
PRAGMA user_version = 1;
"""


@pytest.fixture
def link(tmp_path: Path) -> Link:
    return Link(tmp_path)


def delete_folder(link: Link) -> None:
    shutil.rmtree(link.run_dir)


def delete_database(link: Link) -> None:
    (link.run_dir / "run.sqlite").unlink()


def delete_newest_messages(link: Link) -> None:
    (link.run_dir / "run.sqlite-wal").unlink()


def move_folder(link: Link) -> None:
    link.run_dir.rename(link.folder / "moved")


def replace_database(link: Link) -> None:
    other = link.folder / "other.sqlite"
    RunDatabase(other, None, recorder_id=9).close()
    other.replace(link.run_dir / "run.sqlite")


@pytest.mark.requirement("CM_MR_01")
@pytest.mark.parametrize(
    "take_away", [delete_folder, delete_database, delete_newest_messages, move_folder, replace_database]
)
def test_what_is_said_after_the_database_was_taken_away_is_in_another_one(
    link: Link, take_away: Callable[[Link], None]
) -> None:
    link.run(3.0, link.say)
    before = link.said
    take_away(link)
    link.run(3.0, link.say)
    link.run(8.0)
    link.run(3.0, link.say)
    link.run(2.0)
    assert set(range(before + 1, link.said + 1)) <= set(map(int, link.stored()))
    assert link.outbox.stored_bytes == 0
    assert (link.run_dir / "trajectory.tum").exists()
    told = take_away is not delete_newest_messages  # those the open database still had
    assert link.status.error_code == (ErrorCode.DATABASE_LOST if told else ErrorCode.OK)
    assert ("deleted or replaced" in link.status.detail) == told
    if take_away is move_folder:
        assert poses_in(link.folder / "moved") == [float(k) for k in range(1, link.said + 1)][: -len(link.stored())]


@pytest.mark.requirement("CM_MR_01")
def test_a_database_that_is_damaged_while_it_is_open_is_put_aside_and_another_begun(link: Link) -> None:
    link.run(3.0, link.say)
    before = link.said
    assert link.recorder._run is not None
    damage(link.recorder._run.database.connection, link.run_dir / "run.sqlite")
    link.run(3.0, link.say)
    link.run(2.0)
    assert set(range(before + 1, link.said + 1)) <= set(map(int, link.stored()))
    assert link.status.error_code == ErrorCode.DATABASE_LOST
    assert "malformed" in link.status.detail
    assert "run.aside-1.sqlite" in link.status.detail
    assert (link.run_dir / "run.aside-1.sqlite").stat().st_size > 0


def no_database(file: Path) -> None:
    file.write_bytes(b"no database at all " * 1000)


def of_a_newer_program(file: Path) -> None:
    with sqlite3.connect(file) as database:
        database.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")


def of_a_schema_that_is_no_text(file: Path) -> None:
    RunDatabase(file, None, 1).close()
    spoil_schema(file)


@pytest.mark.requirement("CM_MR_01")
@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (no_database, "is no run database"),
        (of_a_newer_program, "written by a newer program"),
        (of_a_schema_that_is_no_text, "malformed database schema"),
    ],
)
def test_what_a_recorder_cannot_go_on_with_is_kept_and_the_true_reason_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, spoil: Callable[[Path], None], reason: str
) -> None:
    (tmp_path / "run").mkdir()
    spoil(tmp_path / "run" / "run.sqlite")
    spoilt = (tmp_path / "run" / "run.sqlite").read_bytes()
    link = Link(tmp_path)
    link.run(2.0, link.say)
    link.run(2.0)
    link.assert_all_once()
    assert (tmp_path / "run" / "run.aside-1.sqlite").read_bytes() == spoilt
    for told in (link.status.detail, caplog.text):
        assert reason in told
        assert "free space" not in told


def test_a_run_of_the_first_version_is_read_and_gone_on_with(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with sqlite3.connect(tmp_path / "run" / "run.sqlite") as database:
        database.executescript(VERSION_1)
        for k in (1, 2, 5):
            row = (POSE.key, 8, k, float(k), 0.0, encode(pose(float(k)), k, 8))
            database.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?, ?, ?, ?, NULL)", row)
        database.executemany("INSERT INTO dropped VALUES (?, 8, ?)", [(POSE.key, 2), (PERMIT.key, 3)])
    database.close()
    dropped = {(POSE.key, 8): 2, (PERMIT.key, 8): 3}
    with RunReader(tmp_path / "run") as run:
        assert run.dropped() == dropped
    link = Link(tmp_path)
    link.run(1.0, link.say)
    link.run(1.0)
    assert link.stored() == [1.0, 2.0, 5.0, *(float(k) for k in range(1, link.said + 1))]
    with link.reader() as run:
        assert run.dropped() == dropped
    assert len(run_folder.read_tum(tmp_path / "run" / "trajectory.tum")[0]) == 3 + link.said - 5


def test_what_is_acknowledged_is_on_the_medium_but_for_runs_in_lockstep(tmp_path: Path) -> None:
    for date, full in (("2026-01-02T03:04:05+00:00", 2), (None, 1)):
        database = RunDatabase(tmp_path / f"{full}.sqlite", date, recorder_id=1)
        assert database.connection.execute("PRAGMA synchronous").fetchone() == (full,)
        database.close()


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What the files of a run were made from, message by message; summed up every 50 rows."""
    payloads: list[object] = []
    take = RunFiles.take

    def counted(files: RunFiles, payload: object) -> None:
        payloads.append(payload)
        take(files, payload)

    monkeypatch.setattr(RunFiles, "take", counted)
    monkeypatch.setattr(kept_run, "SUMMARY_ROWS", 50)
    return payloads


def restart(link: Link, *, killed: bool) -> None:
    if killed:
        link.recorder._run.database.close()  # type: ignore[union-attr]
    else:
        link.recorder.close()
    link.start_recorder()
    link.run(0.1)


FILES = ("trajectory.tum", "map_points.csv", "pois.json", "photos/poi_1.jpg")


@pytest.mark.parametrize("killed", [True, False])
def test_a_restarted_recorder_reads_what_came_since_its_summary_and_not_the_whole_run(
    link: Link, taken: list[object], killed: bool
) -> None:
    link.module.publish(POI, door(1, 5000))
    link.run(60.0, link.say)
    taken.clear()
    restart(link, killed=killed)
    assert len(taken) <= (recorder.WRITE_PERIOD_S + 1.0) / 0.05
    link.run(5.0, link.say)
    link.run(11.0)
    gone_on = [(link.run_dir / name).read_bytes() for name in FILES]
    # A folder that does not hold what the summary speaks of: all of it is made anew
    for name in FILES:
        (link.run_dir / name).unlink()
    taken.clear()
    restart(link, killed=killed)
    assert len(taken) == link.said + 1
    link.run(11.0)
    assert [(link.run_dir / name).read_bytes() for name in FILES] == gone_on
