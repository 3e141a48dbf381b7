"""Node `recorder`: the laptop's side of the Communication Module. `OUTBOX` -> `run.sqlite` -> `RECEIPT` (CM_MR_01).

The robot's messages come through the outbox of comm, the laptop's own directly: receive, validate, store.
Acknowledged is what the database holds, safe from a power cut; the files of the run folder are made from it. Its
process is the Zenoh router of the laptop. While the disk takes nothing, nothing is acknowledged and nothing piles up
here: the robot keeps it.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from common.bus import Bus
from common.database import disk_full, lost
from common.disk_worker import DISK_ERRORS, DiskError, DiskWorker
from common.errors import ErrorCode
from common.messages import LAPTOP_RECORDED, OUTBOX, RECEIPT, ROBOT_RECORDED, OutboxReceipt
from common.recording import Losses, RecordedMessage, add_loss
from common.status import StatusReporter
from common.undecodable import Undecodable
from offboard.recorder.live_copies import LiveCopies
from offboard.recorder.outbox_inbox import OutboxInbox
from offboard.recorder.run_opening import OpenRun, open_run, reopen_run
from offboard.recorder.run_schema import Delivery, Result, Summary

WRITE_PERIOD_S = 10.0
STORE_PERIOD_S = 0.25  # of the laptop's own messages; what the outbox brings is stored at once
RETRY_S = 1.0  # after the disk refused
RECEIPT_PERIOD_S = 1.0
WAITING_MAX = 4096  # messages of the laptop's own that wait for the disk
SUMMARY_ROWS = 10_000  # so many new messages at most are read at a restart, and those of one WRITE_PERIOD_S
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
        self._disk: DiskWorker[OpenRun | Result] = DiskWorker("recorder", at_once=date is None)
        self._run: OpenRun | None = None
        self._lost: DiskError | None = None  # why there must be another database
        # Of a new run; one that is continued keeps its own, so that the robot's outbox knows it again
        self._inbox = OutboxInbox(1 if date is None else 1 + secrets.randbelow(2**48))
        self._copies = LiveCopies((), {})
        self._waiting: list[RecordedMessage] = []
        self._dropped: Losses = {}
        self._delivery: Delivery | None = None  # handed to the disk, not known to be there
        self._row = self._summary_row = 0  # the files hold the messages up to here, and a summary those up to there
        self._summary: Summary | None = None  # to be stored
        self._store_due_s = self._open_due_s = float("-inf")
        self._receipt: OutboxReceipt | None = None
        self._undecodable = Undecodable("stored but undecodable")
        self._next_write_s: float | None = None
        self._drawn = False
        self._refusal: DiskError | None = None  # why the disk takes nothing at present
        self._told_lost = ""

    @property
    def finished(self) -> bool:
        """The database holds the Planner's word that the mission is finished."""
        return self._run is not None and self._run.files.finished

    def step(self, bus: Bus, now_s: float) -> None:
        self._open_in_time(now_s)
        self._look_at_disk(bus, now_s)
        run = self._run
        if run is not None and self._lost is None:
            self._receive_data(bus, now_s)
            self._store_data(run, now_s)
            self._acknowledge(bus, now_s)
            self._write_in_time(run, now_s)
        self._report(bus, now_s)

    def close(self) -> None:
        """Store and write everything that is not on the disk yet, pictures of the map included."""
        outcome = self._disk.close()
        done = outcome.value if outcome is not None else None
        if isinstance(done, OpenRun):
            self._run, self._lost = done, None
        elif done is not None:
            self._stored(done)
        run = self._run
        if run is None:
            return
        if self._lost is None:
            self._store_at_once(run)
            self._write(run, with_pictures=True)
            self._on_disk(lambda: self._sum_up(run))
            self._store_at_once(run)
        run.files.close()
        run.database.close()
        self._run = None

    def _open_in_time(self, now_s: float) -> None:
        run, error = self._run, self._lost
        wanted = run is None or error is not None
        if not wanted or self._disk.busy or now_s < self._open_due_s:
            return
        self._open_due_s = now_s + RETRY_S
        if run is None or error is None:
            self._disk.begin(lambda: open_run(self.run_dir, self._date, self._inbox.recorder_id))
        else:
            self._disk.begin(lambda: reopen_run(run, error, self._date))

    def _opened(self, run: OpenRun, bus: Bus) -> None:
        first, self._run, self._lost = self._run is None, run, None
        self._disk_takes_it()
        if run.lost:
            _log.error(run.lost)
            self._told_lost = run.lost
        self._inbox.recorder_id = run.database.recorder_id
        self._row = self._summary_row = 0
        self._summary = None
        if self._delivery is not None:
            self._delivery.summary = None
        if first:
            heard = run.database.heard((*LAPTOP_RECORDED, *_OF_COMM))
            self._copies = LiveCopies((topic.key for topic in _OF_COMM), run.database.heard(_OF_COMM))
            bus.record((*LAPTOP_RECORDED, *_OF_COMM), heard)
            bus.take(OUTBOX)

    def _receive_data(self, bus: Bus, now_s: float) -> None:
        for piece in bus.take(OUTBOX):
            self._inbox.take(piece, now_s)
        # What does not fit stays with the bus, and with the producers beyond that
        if len(self._waiting) < WAITING_MAX:
            self._waiting += self._copies.keep(bus.take_recorded())
            copied = {topic.key for topic in _OF_COMM}  # for these the outbox answers
            for source, span in bus.take_lost().items():
                if source[0] not in copied:
                    add_loss(self._dropped, source, *span)

    def _store_data(self, run: OpenRun, now_s: float) -> None:
        due = self._inbox.complete is not None or now_s >= self._store_due_s
        if self._refusal is not None:
            due = now_s >= self._store_due_s
        delivery = self._make_delivery(now_s) if due and not self._disk.busy else None
        if delivery is None:
            return
        self._store_due_s = now_s + (STORE_PERIOD_S if self._refusal is None else RETRY_S)
        self._disk.begin(lambda: run.database.store_data(delivery))

    def _store_at_once(self, run: OpenRun) -> None:
        delivery = self._make_delivery(0.0 if self._receipt is None else self._receipt.t_s)
        if delivery is not None:
            self._on_disk(lambda: self._stored(run.database.store_data(delivery)))

    def _make_delivery(self, now_s: float) -> Delivery | None:
        """What is to be stored now, or is still to be stored; None when there is nothing."""
        new = self._inbox.complete is not None or self._waiting or self._dropped or self._summary is not None
        if self._delivery is None and new:
            delivery = self._delivery = Delivery(now_s, summary=self._summary)
            if self._inbox.complete is not None:
                content = self._inbox.content()
                delivery.messages, delivery.dropped = self._copies.complete(content.messages), content.dropped
                delivery.from_outbox = True
            delivery.messages += self._waiting
            for source, span in self._dropped.items():
                add_loss(delivery.dropped, source, *span)
            self._waiting, self._dropped, self._summary = [], {}, None
        return self._delivery

    def _look_at_disk(self, bus: Bus, now_s: float) -> None:
        outcome = self._disk.outcome()
        if outcome is None:
            return
        if isinstance(outcome.value, OpenRun):
            self._opened(outcome.value, bus)
        elif outcome.value is not None:
            self._stored(outcome.value)
        elif outcome.error is not None and lost(outcome.error) and self._run is not None:
            self._lost, self._open_due_s = outcome.error, now_s
        elif outcome.error is not None:
            self._refused(outcome.error)
            self._store_due_s = now_s + RETRY_S

    def _stored(self, result: Result) -> None:
        delivery, self._delivery = self._delivery, None
        if delivery is not None and delivery.from_outbox:
            self._inbox.stored()
        if delivery is not None and delivery.summary is not None:
            self._summary_row = delivery.summary.row
        self._row = result.row
        for topic, problem in result.problems.items():
            self._undecodable.count(topic, problem)
        if self._run is not None:
            for message in result.stored:
                self._run.files.take(message.payload)
            self._on_disk(self._run.files.append_poses)

    def _acknowledge(self, bus: Bus, now_s: float) -> None:
        receipt, said = self._inbox.receipt(now_s), self._receipt
        if receipt is None:
            return
        if said is None or replace(receipt, t_s=said.t_s) != said or now_s >= said.t_s + RECEIPT_PERIOD_S:
            self._receipt = receipt
            bus.publish(RECEIPT, receipt)

    def _write_in_time(self, run: OpenRun, now_s: float) -> None:
        if self._next_write_s is None:
            self._next_write_s = now_s + WRITE_PERIOD_S
        ends = run.files.finished and not self._drawn
        if ends or now_s >= self._next_write_s:
            self._next_write_s = now_s + WRITE_PERIOD_S
            self._write(run, with_pictures=ends)
            if self._row - self._summary_row >= SUMMARY_ROWS:
                self._on_disk(lambda: self._sum_up(run))
        self._drawn = run.files.finished

    def _write(self, run: OpenRun, *, with_pictures: bool) -> None:
        files = run.files
        if self._on_disk(files.append_poses) and self._on_disk(files.write) and with_pictures:
            self._on_disk(files.draw)

    def _sum_up(self, run: OpenRun) -> None:
        data = run.files.summary()
        if data is not None:
            self._summary = Summary(self._row, data)

    def _on_disk(self, action: Callable[[], object]) -> bool:
        """Do it, or say once why the disk refused."""
        try:
            action()
        except DISK_ERRORS as error:
            self._refused(error)
            return False
        self._disk_takes_it()
        return True

    def _disk_takes_it(self) -> None:
        if self._refusal is not None:
            _log.info("the disk takes the run again run_dir=%s", self.run_dir)
        self._refusal = None

    def _refused(self, error: DiskError) -> None:
        if self._refusal is None:
            advice = f"free space on the disk of {self.run_dir}" if disk_full(error) else f"look at {self.run_dir}"
            _log.error("cannot write the run (%s): %s", _reason(error), advice)
        self._refusal = error

    def _report(self, bus: Bus, now_s: float) -> None:
        if self._refusal is not None:
            error = ErrorCode.DISK_FULL if disk_full(self._refusal) else ErrorCode.DISK_REFUSES
        elif self._inbox.another_is_served(now_s):
            error = ErrorCode.SECOND_RECORDER
        else:
            error = ErrorCode.DATABASE_LOST if self._told_lost else ErrorCode.OK
        missing = self._run.files.map.missing if self._run is not None else 0
        undecodable = sum(self._undecodable.counts.values())
        said = (
            f"cannot write the run ({_reason(self._refusal)})" if self._refusal is not None else "",
            self._told_lost,
            f"{missing} map points were lost on the way" if missing else "",
            f"{undecodable} messages could not be decoded" if undecodable else "",
        )
        state = "finished" if self.finished else "recording"
        self._status.report(bus, now_s, state=state, error=error, ready=True, detail=", ".join(filter(None, said)))


def _reason(error: DiskError) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
