"""From the outbox into the database: once and in order, whatever of the two forgets, fails or is full meanwhile."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from common.bus import LocalMesh
from common.errors import ErrorCode
from common.messages import (
    LOG,
    OUTBOX,
    POI,
    POSE,
    RECEIPT,
    STATUS,
    LogLine,
    OutboxPiece,
    OutboxReceipt,
    PointOfInterest,
    PoseEstimate,
    Status,
)
from offboard.recorder.recorder import Recorder
from offboard.recorder.run_database import RunReader
from onboard.comm.outbox import ROW_PERIOD_S, THINNED_TO, Outbox
from onboard.comm.outbox_sender import PIECE_BYTES
from onboard.comm.outbox_store import OutboxStore, open_store


def pose(t_s: float) -> PoseEstimate:
    return PoseEstimate(t_s, t_s, 0.0, 0.0, 0.0, 0.01, 0.01, 1)


def door(number: int, photo_bytes: int) -> PointOfInterest:
    return PointOfInterest(1.0, number, "Door", "", 1.0, 2.0, "", "", 0.9, "read", bytes(photo_bytes))


class Link:
    """A robot with an outbox, a laptop with a recorder, and the link between them, which may be cut."""

    def __init__(self, folder: Path, limit_bytes: int = 100_000_000) -> None:
        self.folder, self.limit_bytes = folder, limit_bytes
        self.robot, self.laptop = LocalMesh(1), LocalMesh(2)
        self.module = self.robot.endpoint("mmu")
        self.far = self.robot.endpoint("far"), self.laptop.endpoint("far")
        for bus in self.far:
            bus.take(OUTBOX)
        self.connected = True
        self.said = self.lives = 0
        self.crossed: list[OutboxPiece] = []
        self.start_outbox()
        self.start_recorder()
        self.run(0.1)

    def start_outbox(self) -> None:
        self.comm = self.robot.endpoint("comm")
        self.lives += 1
        self.outbox = Outbox(self.folder / "outbox.sqlite", self.limit_bytes, new_id=4 + self.lives)

    def start_recorder(self) -> None:
        self.bus = self.laptop.endpoint("recorder")
        self.recorder = Recorder(self.folder / "run")

    def say(self, count: int = 1) -> None:
        for _ in range(count):
            self.said += 1
            self.module.publish(POSE, pose(float(self.said)))

    def run(self, duration_s: float, each: Callable[[], object] = lambda: None) -> None:
        for _ in range(round(duration_s / 0.05)):
            self.robot.now_s = self.laptop.now_s = round(self.robot.now_s + 0.05, 6)
            each()
            self.outbox.step(self.comm, self.robot.now_s)
            self.cross()
            self.recorder.step(self.bus, self.laptop.now_s)
            self.cross()

    def cross(self) -> None:
        at_robot, at_laptop = self.far
        pieces = at_robot.take(OUTBOX)
        receipt = at_laptop.latest(RECEIPT)
        if not self.connected:
            return
        for piece in pieces:
            self.crossed.append(piece)
            at_laptop.publish(OUTBOX, piece)
        if receipt is not None and receipt is not at_robot.latest(RECEIPT):
            at_robot.publish(RECEIPT, receipt)

    def reader(self) -> RunReader:
        return RunReader(self.folder / "run")

    def stored(self) -> list[float]:
        with self.reader() as run:
            return [message.payload.t_s for message in run.messages(POSE)]

    def assert_all_once(self) -> None:
        assert self.stored() == [float(k) for k in range(1, self.said + 1)]
        assert self.outbox.stored_bytes == 0


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
    heard = store.heard
    store.close()
    newest = next(sequence for (key, _), sequence in heard.items() if key == POSE.key)
    link.start_outbox()
    link.connected = True
    link.run(5.0)
    assert link.stored() == [float(k) for k in range(1, newest + 1)]


def test_a_recorder_that_was_killed_in_the_middle_of_a_photo_goes_on(link: Link) -> None:
    photo_bytes = 10 * PIECE_BYTES
    link.module.publish(POI, door(1, photo_bytes))
    link.run(ROW_PERIOD_S + 0.2)
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
    link.far[1].take(OUTBOX)
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
    link.folder = link.folder / "other"
    link.start_recorder()
    link.run(3.0, link.say)
    link.run(2.0)
    assert link.stored() == [float(k) for k in range(before + 1, link.said + 1)]


def test_above_its_limit_only_status_and_log_thin_out_and_the_database_says_how_many(tmp_path: Path) -> None:
    link = Link(tmp_path, limit_bytes=20_000)
    beats = 0

    def talk() -> None:
        nonlocal beats
        beats += 1
        link.say()
        link.module.publish(STATUS["mmu"], Status(0.0, "RUN", 0, 0, True, beats))
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
        assert counts[topic] + dropped[topic] == beats
        assert dropped[topic] > beats / 2
        assert counts[topic] >= beats / THINNED_TO


def test_a_full_disk_of_the_laptop_keeps_everything_on_the_robot_until_there_is_space(link: Link) -> None:
    link.run(2.0, link.say)
    assert link.recorder._run is not None
    database = link.recorder._run.database.connection
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count = {pages}")
    link.run(60.0, link.say)
    status = link.bus.latest(STATUS["recorder"])
    assert status is not None
    assert status.error_code == ErrorCode.DISK_FULL
    assert link.outbox.stored_bytes > 50_000
    database.execute("PRAGMA max_page_count = 1000000")
    link.run(20.0)
    link.assert_all_once()
    status = link.bus.latest(STATUS["recorder"])
    assert status is not None
    assert status.error_code == ErrorCode.OK


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
    link.outbox._collect(link.comm)
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


def test_an_outbox_file_that_is_none_is_put_aside(tmp_path: Path) -> None:
    file = tmp_path / "outbox.sqlite"
    file.write_bytes(b"no database at all" * 100)
    store = open_store(file)
    assert store.heard == {}
    assert (tmp_path / "outbox.aside-1.sqlite").exists()
    store.close()
    with sqlite3.connect(file) as database:
        assert database.execute("SELECT count(*) FROM rows").fetchone() == (0,)


def test_an_outbox_that_cannot_be_on_the_disk_works_in_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert open_store(tmp_path / "file" / "outbox.sqlite").look().first is None
