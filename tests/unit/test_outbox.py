"""From the outbox into the database: once and in order, whatever of the two forgets, fails or is full meanwhile."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from common.bus import LocalMesh
from common.errors import ErrorCode
from common.messages.delivery import OutboxPiece, OutboxReceipt
from common.messages.health import LogLine, Status
from common.messages.topics import LOG, OUTBOX, POI, POSE, RECEIPT, STATUS
from common.recording import KNOWN_BOOTS
from offboard.recorder.recorder import Recorder
from onboard.comm import outbox, outbox_store
from onboard.comm.outbox import ROW_PERIOD_S, THINNED_TO
from onboard.comm.outbox_sender import OWNER_SILENCE_S, PIECE_BYTES
from onboard.comm.outbox_store import OutboxStore, open_store
from tests.unit.damage import spoil_schema
from tests.unit.outbox_link import Link, damage, door, poses_in


@pytest.fixture
def link(tmp_path: Path) -> Link:
    return Link(tmp_path)


@pytest.mark.requirement("CM_MR_01")
def test_ten_minutes_without_a_link_lose_nothing(link: Link) -> None:
    link.run(2.0, link.say)
    link.connected = False
    link.run(600.0, link.say)
    assert link.outbox.stored_bytes > 500_000
    link.connected = True
    link.run(60.0)
    link.assert_all_once()


def test_a_link_that_flaps_loses_and_doubles_nothing(link: Link) -> None:
    for k in range(20):
        link.connected = k % 2 == 0
        link.run(3.0, link.say)
    link.connected = True
    link.run(20.0)
    link.assert_all_once()


def test_an_outbox_that_was_killed_goes_on_where_its_disk_says(link: Link) -> None:
    link.connected = False
    link.run(5.0, link.say)
    # Not closed: what was not yet on the disk is gone with it
    link.outbox._store.close()
    store = OutboxStore(link.folder / "outbox.sqlite")
    heard = store.received
    store.close()
    newest = next(sequence for (key, _), sequence in heard.items() if key == POSE.key)
    link.start_outbox()
    link.connected = True
    link.run(5.0)
    assert link.stored() == [float(k) for k in range(1, newest + 1)]


def test_a_recorder_that_was_killed_in_the_middle_of_a_photo_goes_on(link: Link) -> None:
    photo_bytes = 10 * PIECE_BYTES
    link.module.publish(POI, door(1, photo_bytes))
    link.run(0.2)
    assert 1 < len(link.crossed) < 10
    link.recorder._run.database.close()  # type: ignore[union-attr]
    link.start_recorder()
    link.run(10.0, link.say)
    link.run(2.0)
    link.assert_all_once()
    with link.reader() as run:
        assert [len(poi.photo_jpeg) for poi in run.pois()] == [photo_bytes]
    assert (link.folder / "run" / "photos" / "poi_1.jpg").stat().st_size == photo_bytes


@pytest.mark.parametrize("steps", range(1, 16))
def test_a_recorder_that_is_killed_at_any_moment_goes_on(link: Link, steps: int) -> None:
    link.module.publish(POI, door(1, 3 * PIECE_BYTES))
    link.run(steps * 0.05, link.say)
    link.recorder._run.database.close()  # type: ignore[union-attr]
    link.laptop = LocalMesh(3)
    link.far = link.far[0], link.laptop.endpoint("far")
    link.far[1].take(RECEIPT)
    link.start_recorder()
    link.run(5.0, link.say)
    link.run(5.0)
    link.assert_all_once()


@pytest.mark.parametrize("steps", range(1, 16))
def test_an_outbox_that_ends_at_any_moment_goes_on(link: Link, steps: int) -> None:
    link.module.publish(POI, door(1, 3 * PIECE_BYTES))
    link.run(steps * 0.05, link.say)
    link.outbox.close()
    link.start_outbox()
    link.run(0.05)
    link.run(5.0, link.say)
    link.run(5.0)
    link.assert_all_once()


def test_no_piece_is_longer_than_its_limit_and_none_is_sent_twice_without_need(link: Link) -> None:
    for k in range(3):
        link.module.publish(POI, door(k, 5 * PIECE_BYTES))
    link.run(10.0, link.say)
    assert max(len(piece.data) for piece in link.crossed) <= PIECE_BYTES
    places = [(piece.number, piece.offset) for piece in link.crossed]
    assert places == sorted(places)


def test_an_outbox_that_goes_to_a_new_recorder_begins_with_what_nobody_has(link: Link) -> None:
    link.run(3.0, link.say)
    link.run(2.0)
    before = link.said
    link.recorder.close()
    link.run_dir = link.folder / "other"
    link.start_recorder()
    link.run(3.0, link.say)
    link.run(2.0)
    assert link.stored() == [float(k) for k in range(before + 1, link.said + 1)]


def test_above_its_limit_only_status_and_log_thin_out_and_the_database_says_how_many(tmp_path: Path) -> None:
    link = Link(tmp_path, limit_bytes=20_000)
    heartbeat_count = 0

    def talk() -> None:
        nonlocal heartbeat_count
        heartbeat_count += 1
        link.say()
        link.module.publish(STATUS["mmu"], Status(0.0, "RUN", 0, 0, True, heartbeat_count))
        link.module.publish(LOG["mmu"], LogLine(0.0, "INFO", "text"))

    link.connected = False
    link.run(50.0, talk)
    assert link.outbox.thinning
    link.connected = True
    link.run(20.0)
    link.assert_all_once()
    assert not link.outbox.thinning
    with link.reader() as run:
        counts, dropped = run.counts(), {topic: count for (topic, _), count in run.dropped().items()}
    assert set(dropped) == {STATUS["mmu"].key, LOG["mmu"].key}
    for topic in dropped:
        assert counts[topic] + dropped[topic] == heartbeat_count
        assert dropped[topic] > heartbeat_count / 2
        assert counts[topic] >= heartbeat_count / THINNED_TO


def test_a_full_disk_of_the_laptop_keeps_everything_on_the_robot_until_there_is_space(link: Link) -> None:
    link.run(2.0, link.say)
    assert link.recorder._run is not None
    database = link.recorder._run.database.connection
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count = {pages}")
    link.run(60.0, link.say)
    assert link.status.error_code == ErrorCode.DISK_FULL
    assert link.outbox.stored_bytes > 50_000
    database.execute("PRAGMA max_page_count = 1000000")
    link.run(20.0)
    link.assert_all_once()
    assert link.status.error_code == ErrorCode.OK


def test_a_full_disk_of_the_robot_keeps_messages_in_memory(link: Link) -> None:
    link.connected = False
    link.run(2.0, link.say)
    database = link.outbox._store._database
    assert database is not None
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count = {pages}")
    link.run(20.0, link.say)
    database.execute("PRAGMA max_page_count = 1000000")
    link.connected = True
    link.run(10.0)
    link.assert_all_once()


def test_what_waits_when_comm_ends_is_on_the_disk(link: Link) -> None:
    link.connected = False
    link.run(1.0, link.say)
    link.say(3)
    link.outbox.close()
    link.start_outbox()
    link.connected = True
    link.run(5.0)
    link.assert_all_once()


def test_pieces_and_receipts_that_make_no_sense_change_nothing(link: Link) -> None:
    at_robot, at_laptop = link.far
    for piece in (
        OutboxPiece(0.0, 5, 1, 0, 10**12, b"x"),
        OutboxPiece(0.0, 9, 3, 7, 20, b"y" * 50),
        OutboxPiece(0.0, 9, 3, 0, 4, b"\xff\xff\xff\xff"),
        OutboxPiece(0.0, 9, 4, 0, 0, b""),
    ):
        at_laptop.publish(OUTBOX, piece)
        link.run(0.3, link.say)
    at_robot.publish(RECEIPT, OutboxReceipt(0.0, 4, 10**9))
    link.run(5.0, link.say)
    link.run(5.0)
    link.assert_all_once()


@pytest.mark.requirement("CM_MR_01")
@pytest.mark.parametrize(("row", "offset"), [(10**9, 0), (3, 10**7), (2**80, 0), (3, -1)])
def test_a_receipt_beyond_what_was_sent_is_refused_and_told(
    link: Link, caplog: pytest.LogCaptureFixture, row: int, offset: int
) -> None:
    link.run(2.0, link.say)
    link.connected = False
    link.run(5.0, link.say)
    rows = link.outbox._sender.rows
    assert rows is not None
    receipt = OutboxReceipt(0.0, link.outbox._sender.outbox_id, rows.number if row == 3 else row, offset)
    link.far[0].publish(RECEIPT, replace(receipt, total_bytes=len(rows.data), recorder_id=1))
    link.run(2.0, link.say)
    assert ("receipt refused" in caplog.text) == (row == 10**9 or offset == 10**7)
    link.connected = True
    link.run(10.0)
    link.assert_all_once()


@pytest.mark.requirement("CM_MR_01")
def test_a_robot_whose_disk_fell_back_in_time_loses_nothing_of_what_is_said_afterwards(link: Link) -> None:
    link.run(2.0, link.say)
    before = {file: file.read_bytes() for file in link.folder.glob("outbox.sqlite*")}
    link.run(5.0, link.say)
    link.run(1.0)
    link.outbox._store.close()
    for file, data in before.items():
        file.write_bytes(data)
    link.start_outbox()
    link.run(0.05)
    link.run(5.0, link.say)
    link.run(2.0)
    link.assert_all_once()


@pytest.mark.requirement("CM_MR_01")
def test_a_second_recorder_is_told_so_and_takes_over_once_the_first_is_silent(link: Link) -> None:
    link.run(1.0, link.say)
    second_bus = link.laptop.endpoint("second")
    second = Recorder(link.folder / "second")
    second._inbox.recorder_id = 2

    def both() -> None:
        link.say()
        second.step(second_bus, link.laptop.now_s)

    # The first one's disk takes nothing: what the second acknowledged meanwhile would be lost to the first
    assert link.recorder._run is not None
    database = link.recorder._run.database.connection
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count = {pages}")
    link.run(20.0, both)
    assert {ErrorCode.DISK_FULL, ErrorCode.SECOND_RECORDER} <= link.errors()
    database.execute("PRAGMA max_page_count = 1000000")
    link.run(10.0, both)
    link.run(2.0, lambda: second.step(second_bus, link.laptop.now_s))
    link.assert_all_once()
    assert poses_in(link.folder / "second") == []
    first_has = link.said
    link.recorder.close()
    link.recorder, link.bus = second, second_bus
    link.run(OWNER_SILENCE_S + 5.0, link.say)
    link.run(5.0)
    assert poses_in(link.folder / "second") == [float(k) for k in range(first_has + 1, link.said + 1)]
    link.errors()
    link.run(1.0)
    assert link.errors() == {ErrorCode.OK}


def test_known_senders_are_bounded_and_written_only_when_they_have_spoken(link: Link) -> None:
    for life in range(3 * KNOWN_BOOTS):
        link.module = link.robot.endpoint(f"mmu {life}")
        link.say()
        link.run(0.3)
    link.outbox.close()
    link.start_outbox()
    assert len(link.outbox._received) == KNOWN_BOOTS
    database = link.outbox._store._database
    assert database is not None
    link.run(1.0)
    before = database.total_changes
    link.run(2.0, link.say)
    link.run(1.0)
    turns = round(2.0 / ROW_PERIOD_S) + 2
    assert database.total_changes - before <= 3 * turns  # a row, its removal, and who spoke
    link.run(2.0)
    assert link.stored() == [float(k) for k in range(1, link.said + 1)]


def test_an_outbox_without_a_disk_is_bounded_thins_out_and_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (outbox, outbox_store):
        monkeypatch.setattr(module, "RAM_BYTES", 400_000)
    monkeypatch.setattr(outbox, "WAITING_BYTES_MAX", 100_000)
    monkeypatch.setattr(outbox, "SAVE_BYTES_MAX", 50_000)
    (tmp_path / "file").write_text("")
    link = Link(tmp_path, outbox_file=tmp_path / "file" / "outbox.sqlite")
    link.connected = False

    def talk() -> None:
        link.say()
        link.module.publish(LOG["mmu"], LogLine(0.0, "INFO", "x" * 500))

    link.run(120.0, talk)
    assert link.outbox.thinning
    assert link.outbox.stored_bytes < 400_000
    assert link.outbox._waiting_bytes < 110_000
    link.connected = True
    link.run(60.0)
    link.assert_all_once()
    with link.reader() as run:
        assert set(run.dropped()) == {(LOG["mmu"].key, link.module._boot_id)}
        ((_, dropped),) = run.dropped().items()
        assert dropped + run.counts()[LOG["mmu"].key] == link.said


def test_a_full_disk_of_the_robot_fills_its_memory_only_so_far(link: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "WAITING_BYTES_MAX", 20_000)
    database = link.outbox._store._database
    assert database is not None
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count = {pages}")
    link.connected = False
    link.run(60.0, link.say)
    assert 20_000 < sum(len(message.data) for message in link.outbox._waiting) < 21_000


def test_an_outbox_that_is_damaged_while_it_is_open_is_put_aside_and_another_begins(link: Link) -> None:
    link.run(2.0, link.say)
    damage(link.outbox._store._database, link.folder / "outbox.sqlite")
    link.run(10.0, link.say)
    link.run(2.0)
    assert (link.folder / "outbox.aside-1.sqlite").exists()
    stored = link.stored()
    assert set(range(1, link.said + 1)) - set(map(int, stored)) <= set(range(35, 46))
    assert link.outbox.stored_bytes == 0


def test_an_outbox_file_that_is_none_is_put_aside(tmp_path: Path) -> None:
    file = tmp_path / "outbox.sqlite"
    file.write_bytes(b"no database at all" * 100)
    store = open_store(file)
    assert store.received == {}
    assert (tmp_path / "outbox.aside-1.sqlite").exists()
    store.close()
    with sqlite3.connect(file) as database:
        assert database.execute("SELECT count(*) FROM rows").fetchone() == (0,)


def test_an_outbox_whose_schema_is_no_text_is_put_aside(tmp_path: Path) -> None:
    file = tmp_path / "outbox.sqlite"
    open_store(file).close()
    spoil_schema(file)
    open_store(file).close()
    assert (tmp_path / "outbox.aside-1.sqlite").exists()


def test_an_outbox_that_cannot_be_on_the_disk_works_in_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert open_store(tmp_path / "file" / "outbox.sqlite").look().first is None
