"""A robot with an outbox, a laptop with a recorder, and the link between them."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

from common.bus import LocalMesh
from common.messages.delivery import OutboxPiece
from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import OUTBOX, POSE, RECEIPT, STATUS
from offboard.recorder.recorder import Recorder
from offboard.runs.run_database import RunReader
from onboard.comm.outbox import Outbox


def pose(t_s: float) -> PoseEstimate:
    return PoseEstimate(t_s, t_s, 0.0, 0.0, 0.0, 0.01, 0.01, 1)


def door(number: int, photo_bytes: int) -> PointOfInterest:
    return PointOfInterest(1.0, number, "Door", "", 1.0, 2.0, "", "", 0.9, "read", bytes(photo_bytes))


def poses_in(run_dir: Path) -> list[float]:
    with RunReader(run_dir) as run:
        return [message.payload.t_s for message in run.messages(POSE)]


def damage(database: sqlite3.Connection | None, file: Path) -> None:
    """Every page of an open database but its first becomes rubbish."""
    assert database is not None
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    size = file.stat().st_size
    with file.open("r+b") as pages:
        pages.seek(4096)
        pages.write(b"\xa5" * (size - 4096))
    database.execute("PRAGMA shrink_memory")


class Link:
    """A robot with an outbox, a laptop with a recorder, and the link between them, which may be cut."""

    def __init__(self, folder: Path, limit_bytes: int = 100_000_000, outbox_file: Path | None = None) -> None:
        self.folder, self.limit_bytes = folder, limit_bytes
        self.outbox_file = outbox_file or folder / "outbox.sqlite"
        self.robot, self.laptop = LocalMesh(1), LocalMesh(2)
        self.module = self.robot.endpoint("mmu")
        self.far = self.robot.endpoint("far"), self.laptop.endpoint("far")
        self.far[0].take(OUTBOX)
        self.far[1].take(RECEIPT)
        self.errors()
        self.connected = True
        self.run_dir = folder / "run"
        self.said = self.lives = 0
        self.crossed: list[OutboxPiece] = []
        self.start_outbox()
        self.start_recorder()
        self.run(0.1)

    def start_outbox(self) -> None:
        self.comm = self.robot.endpoint("comm")
        self.lives += 1
        self.outbox = Outbox(self.outbox_file, self.limit_bytes, new_id=4 + self.lives)

    def start_recorder(self) -> None:
        self.bus = self.laptop.endpoint("recorder")
        self.recorder = Recorder(self.run_dir)

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
        receipts = at_laptop.take(RECEIPT)
        if not self.connected:
            return
        for piece in pieces:
            self.crossed.append(piece)
            at_laptop.publish(OUTBOX, piece)
        for receipt in receipts:
            at_robot.publish(RECEIPT, receipt)

    def reader(self) -> RunReader:
        return RunReader(self.run_dir)

    def stored(self) -> list[float]:
        return poses_in(self.run_dir)

    @property
    def status(self) -> Status:
        """Of the recorder."""
        status = self.bus.latest(STATUS["recorder"])
        assert status is not None
        return status

    def errors(self) -> set[int]:
        """What the recorders said of themselves since the last call."""
        return {status.error_code for status in self.far[1].take(STATUS["recorder"])}

    def assert_all_once(self) -> None:
        assert self.stored() == [float(k) for k in range(1, self.said + 1)]
        assert self.outbox.stored_bytes == 0
