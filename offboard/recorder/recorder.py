"""Node `recorder`: the laptop's side of the Communication Module. `OUTBOX` -> `run.sqlite` -> `RECEIPT` (CM_MR_01).

The robot's messages come through the outbox of comm, the laptop's own directly: receive, validate, store; only what the
database holds is acknowledged, and the files of the run folder are made from it. Its process is the Zenoh router of the
laptop. While the disk takes nothing, nothing is acknowledged and nothing piles up here: the robot keeps it.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable
from pathlib import Path

from common.bus import Bus
from common.disk_worker import DISK_ERRORS, DiskWorker
from common.errors import ErrorCode
from common.frames import Frame, Losses
from common.messages import LAPTOP_RECORDED, OUTBOX, RECEIPT, ROBOT_RECORDED, OutboxReceipt
from common.status import StatusReporter
from common.undecodable import Undecodable
from offboard.recorder import run_folder
from offboard.recorder.live_copies import LiveCopies
from offboard.recorder.outbox_inbox import OutboxInbox
from offboard.recorder.run_database import RunReader
from offboard.recorder.run_files import TOPICS_OF_FILES, RunFiles
from offboard.recorder.run_schema import Delivery, Result, RunDatabase

WRITE_PERIOD_S = 10.0
STORE_PERIOD_S = 0.25  # of the laptop's own messages; what the outbox brings is stored at once
RETRY_S = 1.0  # after the disk refused
RECEIPT_PERIOD_S = 1.0
WAITING_MAX = 4096  # messages of the laptop's own that wait for the disk
_OF_COMM = tuple(topic for topic in ROBOT_RECORDED if topic.producer == "comm")

_log = logging.getLogger("recorder")


class Recorder:
    """Keeps a run. A folder that holds a run already is continued, not overwritten."""

    name = "recorder"
    period_s = 0.05

    def __init__(self, run_dir: Path, date: str | None = None) -> None:
        """`date`: wall time of the start. None for lockstep: no wall time, and the disk's work done in the step."""
        self.run_dir = run_dir
        self._date = date
        self._status = StatusReporter(self.name)
        self._files = RunFiles(run_dir)
        self._disk: DiskWorker[Result] = DiskWorker("recorder", at_once=date is None)
        self._database: RunDatabase | None = None
        self._inbox = OutboxInbox({})
        self._copies = LiveCopies((), {})
        self._waiting: list[Frame] = []
        self._dropped: Losses = {}
        self._delivery: Delivery | None = None  # handed to the disk, not known to be there
        self._store_due_s = self._open_due_s = float("-inf")
        self._receipt: OutboxReceipt | None = None
        self._undecodable = Undecodable("stored but undecodable")
        self._next_write_s: float | None = None
        self._drawn = False
        self._disk_works = True

    @property
    def finished(self) -> bool:
        """The database holds the Planner's word that the mission is finished."""
        return self._files.finished

    def step(self, bus: Bus, now_s: float) -> None:
        if self._database is None and now_s >= self._open_due_s:
            self._open_due_s = now_s + RETRY_S
            self._on_disk(lambda: self._open(bus))
        if self._database is not None:
            self._receive_data(bus)
            self._look_at_disk(now_s)
            self._store_data(now_s)
            self._acknowledge(bus, now_s)
            self._write_in_time(now_s)
        self._report(bus, now_s)

    def close(self) -> None:
        """Store and write everything that is not on the disk yet, pictures of the map included."""
        if self._database is None:
            return
        outcome = self._disk.close()
        if outcome is not None and outcome.value is not None:
            self._stored(outcome.value)
        if self._make_delivery(0.0 if self._receipt is None else self._receipt.t_s) and self._delivery is not None:
            delivery, database = self._delivery, self._database
            self._on_disk(lambda: self._stored(database.store_data(delivery)))
        self._write(with_pictures=True)
        self._files.close()
        self._database.close()
        self._database = None

    def _open(self, bus: Bus) -> None:
        file = self.run_dir / run_folder.DATABASE_NAME
        database = RunDatabase(file, self._date)
        with RunReader(file) as reader:
            self._files.begin(message.payload for message in reader.messages(*TOPICS_OF_FILES))
        self._inbox = OutboxInbox(database.next_rows())
        self._copies = LiveCopies((topic.key for topic in _OF_COMM), database.heard(_OF_COMM))
        bus.tap((*LAPTOP_RECORDED, *_OF_COMM), database.heard((*LAPTOP_RECORDED, *_OF_COMM)))
        bus.take(OUTBOX)
        self._database = database

    def _receive_data(self, bus: Bus) -> None:
        for piece in bus.take(OUTBOX):
            self._inbox.take(piece)
        # What does not fit stays with the bus, and with the producers beyond that
        if len(self._waiting) < WAITING_MAX:
            self._waiting += self._copies.keep(bus.take_frames())
            copied = {topic.key for topic in _OF_COMM}  # for these the outbox answers
            for source, count in bus.take_lost().items():
                if source[0] not in copied:
                    self._dropped[source] = self._dropped.get(source, 0) + count

    def _store_data(self, now_s: float) -> None:
        due = self._inbox.complete is not None or now_s >= self._store_due_s
        if not self._disk_works:
            due = now_s >= self._store_due_s
        database = self._database
        if database is None or self._disk.busy or not due or not self._make_delivery(now_s):
            return
        self._store_due_s = now_s + (STORE_PERIOD_S if self._disk_works else RETRY_S)
        delivery = self._delivery
        assert delivery is not None
        self._disk.begin(lambda: database.store_data(delivery))

    def _make_delivery(self, now_s: float) -> bool:
        """What is to be stored now, or is still to be stored; False when there is nothing."""
        if self._delivery is None and (self._inbox.complete is not None or self._waiting or self._dropped):
            delivery = Delivery(now_s)
            if self._inbox.complete is not None:
                delivery = self._inbox.delivery(now_s)
                delivery.frames = self._copies.complete(delivery.frames)
            delivery.frames += self._waiting
            for source, count in self._dropped.items():
                delivery.dropped[source] = delivery.dropped.get(source, 0) + count
            self._waiting, self._dropped, self._delivery = [], {}, delivery
        return self._delivery is not None

    def _look_at_disk(self, now_s: float) -> None:
        outcome = self._disk.outcome()
        if outcome is None:
            return
        if outcome.value is None:
            self._refused(outcome.error)
            self._store_due_s = now_s + RETRY_S
        else:
            self._stored(outcome.value)

    def _stored(self, result: Result) -> None:
        delivery, self._delivery = self._delivery, None
        if delivery is not None and delivery.outbox_id is not None:
            self._inbox.stored(delivery)
        for topic, problem in result.problems.items():
            self._undecodable.count(topic, problem)
        for message in result.stored:
            self._files.take(message.payload)
        self._on_disk(self._files.append_poses)

    def _acknowledge(self, bus: Bus, now_s: float) -> None:
        receipt, said = self._inbox.receipt(now_s), self._receipt
        if receipt is None:
            return
        wanted = (receipt.outbox_id, receipt.number, receipt.offset, receipt.total_bytes)
        old = said and (said.outbox_id, said.number, said.offset, said.total_bytes)
        if said is None or wanted != old or now_s >= said.t_s + RECEIPT_PERIOD_S:
            self._receipt = receipt
            bus.publish(RECEIPT, receipt)

    def _write_in_time(self, now_s: float) -> None:
        if self._next_write_s is None:
            self._next_write_s = now_s + WRITE_PERIOD_S
        ends = self._files.finished and not self._drawn
        if ends or now_s >= self._next_write_s:
            self._next_write_s = now_s + WRITE_PERIOD_S
            self._write(with_pictures=ends)
        self._drawn = self._files.finished

    def _write(self, *, with_pictures: bool) -> None:
        if self._on_disk(self._files.append_poses) and self._on_disk(self._files.write) and with_pictures:
            self._on_disk(self._files.draw)

    def _on_disk(self, action: Callable[[], object]) -> bool:
        """Do it, or say once why the disk refused."""
        try:
            action()
        except DISK_ERRORS as error:
            self._refused(error)
            return False
        if not self._disk_works:
            _log.info("the disk takes the run again run_dir=%s", self.run_dir)
        self._disk_works = True
        return True

    def _refused(self, error: OSError | sqlite3.Error | None) -> None:
        if self._disk_works:
            reason = error.strerror if isinstance(error, OSError) else error
            _log.error("cannot write the run (%s): free space on the disk of %s", reason, self.run_dir)
        self._disk_works = False

    def _report(self, bus: Bus, now_s: float) -> None:
        missing, undecodable = self._files.map.missing, sum(self._undecodable.counts.values())
        said = (
            f"{missing} map points were lost on the way" if missing else "",
            f"{undecodable} messages could not be decoded" if undecodable else "",
        )
        self._status.report(
            bus,
            now_s,
            state="finished" if self.finished else "recording",
            error=ErrorCode.OK if self._disk_works else ErrorCode.DISK_FULL,
            ready=True,
            detail=", ".join(filter(None, said)),
        )
