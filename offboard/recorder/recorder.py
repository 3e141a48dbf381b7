"""Node `recorder`: the laptop's side of the Communication Module. `OUTBOX` -> `run.sqlite` -> `RECEIPT` (CM_MR_01).

The robot's messages come through the outbox of comm, the laptop's own directly: receive, validate, store.
Acknowledged is what the database holds, safe from a power cut; the files of the run folder are made from it. Its
process is the Zenoh router of the laptop. While the disk takes nothing, nothing is acknowledged and nothing piles up
here: the robot keeps it.

Everything that takes its time, decoding a map of any size included, is done by the thread of the disk (`kept_run.py`);
the pictures are drawn beside that.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.bus import Bus
from common.database import disk_full, lost
from common.disk_worker import DISK_ERRORS, disk_worker
from common.door_names import DoorNote, message_of
from common.errors import ErrorCode
from common.messages.delivery import OutboxReceipt
from common.messages.topics import DOOR_NOTES, LAPTOP_RECORDED, OUTBOX, RECEIPT, Topic
from common.recording import Losses, RecordedMessage, add_loss
from common.status import StatusReporter
from common.undecodable import Undecodable
from offboard.recorder.kept_run import Delivered, Handover, KeptRun, RunState, Written
from offboard.recorder.outbox_inbox import OutboxInbox
from offboard.recorder.pictures import draw, draw_apart
from offboard.recorder.run_opening import OF_COMM, open_run, reopen_run
from offboard.runs.run_schema import Summary

WRITE_PERIOD_S = 10.0
STORE_PERIOD_S = 0.25  # of the laptop's own messages; what the outbox brings is stored at once
RETRY_S = 1.0  # after the disk refused
RECEIPT_PERIOD_S = 1.0
WAITING_MAX = 4096  # messages of the laptop's own that wait for the disk
_COPIED = frozenset(topic.key for topic in OF_COMM)  # for these the outbox answers

_log = logging.getLogger("recorder")


class Recorder:
    """Keeps a run. A folder that holds a run already is continued, not overwritten."""

    name = "recorder"
    period_s = 0.05
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(self, run_dir: Path, date: str | None = None) -> None:
        """`date`: wall time of the start. None for lockstep: no wall time, and the disk's work done in the step."""
        self.run_dir = run_dir
        self._date = date
        self._status = StatusReporter(self.name)
        at_once = date is None
        self._disk = disk_worker("recorder", at_once=at_once)
        self._artist = disk_worker("pictures", at_once=at_once)
        self._draw = draw if at_once else draw_apart
        self._run: KeptRun | None = None  # belongs to the disk's thread from its opening on
        self._state = RunState(finished=False, missing=0)
        self._lost: Exception | None = None  # why there must be another database
        # Of a new run; one that is continued keeps its own, so that the robot's outbox knows it again
        self._inbox = OutboxInbox(1 if at_once else 1 + secrets.randbelow(2**48))
        self._waiting: list[RecordedMessage] = []
        self._dropped: Losses = {}
        self._handover: Handover | None = None  # the disk has it, or refused it; not known to be stored
        self._notes_sent: tuple[tuple[DoorNote, ...], int] = ((), 0)
        self._summary: Summary | None = None  # to be stored
        self._store_due_s = self._open_due_s = float("-inf")
        self._receipt: OutboxReceipt | None = None
        self._undecodable = Undecodable("stored but undecodable")
        self._next_write_s: float | None = None
        self._picture_due = self._drawn = False
        self._refusal: Exception | None = None  # why the disk takes nothing at present
        self._lost_notice = ""

    @property
    def finished(self) -> bool:
        """The database holds the Planner's message that the mission is finished."""
        return self._state.finished

    def step(self, bus: Bus, now_s: float) -> None:
        self._open_in_time(now_s)
        self._look_at_disk(bus, now_s)
        run = self._run
        if run is not None and self._lost is None:
            self._receive_data(bus, now_s)
            self._write_in_time(run, now_s)
            self._draw_in_time(now_s)
            self._store_data(run, now_s)
            self._acknowledge(bus, now_s)
            self._publish_notes(bus, now_s)
        self._report(bus, now_s)

    def close(self) -> None:
        """Store and write everything that is not on the disk yet, pictures of the map included."""
        outcome = self._disk.close()
        self._artist.close()
        done = outcome.value if outcome is not None else None
        if isinstance(done, KeptRun):
            self._run, self._lost = done, None
        elif isinstance(done, Delivered):
            self._delivered(done)
        run = self._run
        if run is None:
            return
        if self._lost is None:
            self._finish(run)
        run.close()
        self._run = None

    def _finish(self, run: KeptRun) -> None:
        """Stores and writes what is left, with the final summary, and draws the pictures; waits for all of it."""
        self._store_at_once(run)
        self._on_disk(lambda: self._written(run.write(sum_up=True)))
        self._store_at_once(run)
        self._draw(self.run_dir)

    def _open_in_time(self, now_s: float) -> None:
        run, error = self._run, self._lost
        wanted = run is None or error is not None
        if not wanted or self._disk.busy or now_s < self._open_due_s:
            return
        self._open_due_s = now_s + RETRY_S
        if run is None or error is None:
            self._disk.begin(lambda: open_run(self.run_dir, self._date, self._inbox.recorder_id), now_s)
        else:
            self._disk.begin(lambda: reopen_run(run, error, self._date), now_s)

    def _opened(self, run: KeptRun, bus: Bus) -> None:
        first, self._run, self._lost = self._run is None, run, None
        self._disk_takes_it()
        if run.lost:
            _log.error(run.lost)
            self._lost_notice = run.lost
        self._inbox.recorder_id = run.database.recorder_id
        self._state = run.state()
        self._summary = None
        if self._handover is not None:
            self._handover.summary = None
        if first:
            bus.record((*LAPTOP_RECORDED, *OF_COMM), run.known)
            bus.take(OUTBOX)

    def _receive_data(self, bus: Bus, now_s: float) -> None:
        for piece in bus.take(OUTBOX):
            self._inbox.take(piece, now_s)
        # What does not fit stays with the bus, and with the producers beyond that
        if len(self._waiting) < WAITING_MAX:
            self._waiting += bus.take_recorded()
            for source, span in bus.take_lost().items():
                if source[0] not in _COPIED:
                    add_loss(self._dropped, source, *span)

    def _store_data(self, run: KeptRun, now_s: float) -> None:
        due = self._inbox.complete is not None or now_s >= self._store_due_s
        if self._refusal is not None:
            due = now_s >= self._store_due_s
        handover = self._make_handover(now_s) if due and not self._disk.busy else None
        if handover is None:
            return
        self._store_due_s = now_s + (STORE_PERIOD_S if self._refusal is None else RETRY_S)
        self._disk.begin(lambda: run.store(handover), now_s)

    def _store_at_once(self, run: KeptRun) -> None:
        handover = self._make_handover(0.0 if self._receipt is None else self._receipt.t_s)
        if handover is not None:
            self._on_disk(lambda: self._delivered(run.store(handover)))

    def _make_handover(self, now_s: float) -> Handover | None:
        """What is to be stored now, or is still to be stored; None when there is nothing."""
        if self._handover is None:
            rows = self._inbox.rows()
            if rows or self._waiting or self._dropped or self._summary is not None:
                self._handover = Handover(now_s, rows, self._waiting, self._dropped, self._summary)
                self._waiting, self._dropped, self._summary = [], {}, None
        return self._handover

    def _look_at_disk(self, bus: Bus, now_s: float) -> None:
        outcome = self._disk.result(now_s)
        if outcome is None:
            return
        if isinstance(outcome.value, KeptRun):
            self._opened(outcome.value, bus)
        elif isinstance(outcome.value, Delivered):
            self._delivered(outcome.value)
        elif outcome.value is not None:
            self._disk_takes_it()
            self._written(outcome.value)
        elif outcome.error is not None and lost(outcome.error) and self._run is not None:
            self._lost, self._open_due_s = outcome.error, now_s
        elif outcome.error is not None:
            self._refused(outcome.error)
            self._store_due_s = now_s + RETRY_S

    def _delivered(self, delivered: Delivered) -> None:
        self._handover = None
        if delivered.newest_row is not None:
            self._inbox.stored(delivered.newest_row)
        for topic, problem in delivered.problems.items():
            self._undecodable.count(topic, problem)
        if delivered.state.finished and not self._state.finished:
            self._next_write_s = float("-inf")
        self._state = delivered.state
        if delivered.refusal is not None:
            self._refused(delivered.refusal)
        else:
            self._disk_takes_it()

    def _written(self, written: Written) -> None:
        self._summary = written.summary
        self._picture_due |= written.finished and not self._drawn
        self._drawn = written.finished

    def _acknowledge(self, bus: Bus, now_s: float) -> None:
        receipt, last = self._inbox.receipt(now_s), self._receipt
        if receipt is None:
            return
        if last is None or replace(receipt, t_s=last.t_s) != last or now_s >= last.t_s + RECEIPT_PERIOD_S:
            self._receipt = receipt
            bus.publish(RECEIPT, receipt)

    def _publish_notes(self, bus: Bus, now_s: float) -> None:
        """What people said of doors, once it is stored: that answers who said it."""
        notes = self._state.notes, self._state.statement_id
        if notes != self._notes_sent:
            self._notes_sent = notes
            bus.publish(DOOR_NOTES, message_of(now_s, notes[1], notes[0]))

    def _write_in_time(self, run: KeptRun, now_s: float) -> None:
        if self._next_write_s is None:
            self._next_write_s = now_s + WRITE_PERIOD_S
        if now_s >= self._next_write_s and not self._disk.busy:
            self._next_write_s = now_s + WRITE_PERIOD_S
            self._disk.begin(run.write, now_s)

    def _draw_in_time(self, now_s: float) -> None:
        self._artist.result(now_s)
        if self._picture_due and not self._artist.busy:
            self._picture_due = False
            self._artist.begin(lambda: self._draw(self.run_dir), now_s)

    def _on_disk(self, action: Callable[[], object]) -> None:
        """Does it; where the disk refuses, logs the reason once."""
        try:
            action()
        except DISK_ERRORS as error:
            self._refused(error)

    def _disk_takes_it(self) -> None:
        if self._refusal is not None:
            _log.info("the disk takes the run again run_dir=%s", self.run_dir)
        self._refusal = None

    def _refused(self, error: Exception) -> None:
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
            error = ErrorCode.DATABASE_LOST if self._lost_notice else ErrorCode.OK
        missing = self._state.missing
        undecodable = sum(self._undecodable.counts.values())
        details = (
            f"cannot write the run ({_reason(self._refusal)})" if self._refusal is not None else "",
            self._lost_notice,
            f"{missing} map points were lost in transit" if missing else "",
            f"{undecodable} messages could not be decoded" if undecodable else "",
        )
        state = "finished" if self.finished else "recording"
        self._status.report(bus, now_s, state=state, error=error, ready=True, detail=", ".join(filter(None, details)))


def _reason(error: Exception) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
