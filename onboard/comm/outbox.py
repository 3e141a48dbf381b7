"""The outbox of comm: every recorded message of the robot's modules -> `OUTBOX`, until `RECEIPT` (CM_MR_01).

Messages wait in RAM for at most ROW_PERIOD_S, then on the disk, and leave it when the recorder acknowledges that
its database has them. A message is identified by sender and number, so that it is stored once, whichever process is
killed and however often the link is lost.

Above its limit on the disk only status and log are thinned out, to one message in THINNED_TO. The numbers that were
published and dropped travel with the rows.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from itertools import accumulate, takewhile
from pathlib import Path
from typing import Protocol, runtime_checkable

from common.bus import Bus
from common.disk_worker import DISK_ERRORS, disk_worker
from common.messages.topics import LOG, OUTBOX, RECEIPT, ROBOT_RECORDED, STATUS
from common.recording import Known, Losses, RecordedMessage, add_loss, remember
from onboard.comm.crash_buffer import CrashBuffer
from onboard.comm.outbox_sender import OutboxSender
from onboard.comm.outbox_store import RAM_BYTES, Batch, OutboxStore, Turn, open_store
from onboard.comm.spool import Spool

ROW_PERIOD_S = 0.5
BACKLOG_PAUSE_S = 0.02  # between two steps while a recorder takes more than one step may send
RETRY_S = 1.0  # after the disk refused
WAITING_BYTES_MAX = 8_000_000  # in RAM, while the disk does not take them
SAVE_BYTES_MAX = 1_000_000  # of them that the disk takes together
THINNED_TO = 10

FILE_NAME = "outbox.sqlite"
_THINNED = frozenset(topic.key for table in (STATUS, LOG) for topic in table.values())

# The recorder stores its own itself; what it could not, being killed, is here
_OF_RECORDER = (STATUS["recorder"], LOG["recorder"])
_RECORDER_KEYS = frozenset(topic.key for topic in _OF_RECORDER)

_log = logging.getLogger("comm")


@runtime_checkable
class SpoolingBus(Protocol):
    """A bus between processes: what is published in this one is lost with it unless somebody keeps it."""

    def spool(self, keep: Callable[[str, bytes], None]) -> None: ...


class Outbox:
    """Part of comm: `step` in every step of it, `close` at its end. No step waits for the disk."""

    def __init__(
        self, file: Path | None, limit_bytes: int, new_id: int | None = None, spool: Spool | None = None
    ) -> None:
        """`new_id`: for lockstep, where the disk's work is done at once and in order. `spool`: of this process."""
        self._store: OutboxStore = open_store(file, new_id)
        self._limit_bytes = min(limit_bytes, RAM_BYTES // 2) if self._store.in_memory else limit_bytes
        self._disk = disk_worker("outbox", at_once=new_id is not None)
        self._bus: Bus | None = None  # from the first step on: what it records
        self._spool, self._spooled = spool, 0  # and its mark of what the disk has been handed
        self._crash_buffer = CrashBuffer(_RECORDER_KEYS)
        self._received: Known = dict(self._store.received)
        self._waiting: list[RecordedMessage] = []  # not known to be on the disk
        self._waiting_bytes = 0
        self._dropped: Losses = {}
        self._handed: tuple[int, Losses] = (0, {})  # how many of those that wait, and what was dropped, the disk has
        self._save_due_s = float("-inf")
        self._next_rows_due = False  # more lies on the disk: no need to wait for the period
        self._loading_next = False  # and the disk is at it
        self._disk_works = True
        turn = self._store.look()
        self._stored_bytes = turn.stored_bytes
        self._sender = OutboxSender(turn.outbox_id, turn.first)
        self._removed = 0  # all rows before this one
        if turn.first is not None:
            _log.info("outbox goes on stored_bytes=%d", turn.stored_bytes)

    @property
    def stored_bytes(self) -> int:
        """What waits on the disk for the recorder."""
        return self._stored_bytes

    @property
    def thinning(self) -> bool:
        return self._stored_bytes > self._limit_bytes or not self._disk_works

    def step(self, bus: Bus, now_s: float) -> None:
        if self._bus is None:
            self._bus = bus
            self._begin_recording(bus)
        self._collect()
        self._look_at_disk(now_s)
        self._take_receipts(bus, now_s)
        self._save(now_s)
        for piece in self._sender.pieces(now_s):
            bus.publish(OUTBOX, piece)

    def due_s(self, now_s: float) -> float:
        """When `step` has something to do though nothing arrives (s); what is never urgent waits for the next step."""
        backlog = self._sender.unsent or self._next_rows_due or self._loading_next
        if backlog and self._sender.is_answered(now_s):
            return now_s + BACKLOG_PAUSE_S
        return self._sender.due_s

    def close(self) -> None:
        """What still waits goes onto the disk, for the next life."""
        outcome = self._disk.close()
        if outcome is not None and outcome.value is not None and outcome.value.refused is None:
            self._forget_saved()
        self._collect()
        if (self._waiting or self._dropped) and self._disk_works:
            with suppress(*DISK_ERRORS):
                self._work(len(self._waiting))()
                self._waiting, self._dropped = [], {}
        if self._spool is not None and not self._waiting:
            self._spool.close()
        self._store.close()

    def _begin_recording(self, bus: Bus) -> None:
        if self._spool is not None and isinstance(bus, SpoolingBus):
            for message in self._spool.left():
                source = (message.key, message.boot_id)
                if message.sequence > self._received.get(source, 0):
                    remember(self._received, source, message.sequence)
                    self._wait([message])
            bus.spool(self._spool.append)
        bus.record((*ROBOT_RECORDED, *_OF_RECORDER), self._received)

    def _collect(self) -> None:
        bus = self._bus
        # What does not fit stays with the bus, and with the producers beyond that
        if bus is None or self._waiting_bytes > WAITING_BYTES_MAX:
            return
        thinning = self.thinning
        kept: list[RecordedMessage] = []
        newest: Known = {}
        for message in bus.take_recorded():
            if message.key in _RECORDER_KEYS:
                kept += self._crash_buffer.add(message)
                continue
            source = (message.key, message.boot_id)
            newest[source] = message.sequence
            if thinning and message.key in _THINNED and message.sequence % THINNED_TO:
                add_loss(self._dropped, source, message.sequence, message.sequence)
            else:
                kept.append(message)
        for source, sequence in newest.items():
            remember(self._received, source, sequence)
        self._wait(kept)
        for source, (first, last) in bus.take_lost().items():
            if source[0] in _RECORDER_KEYS:
                continue
            _log.warning("messages were lost before the outbox topic=%s first=%d last=%d", source[0], first, last)
            add_loss(self._dropped, source, first, last)

    def _wait(self, messages: list[RecordedMessage]) -> None:
        self._waiting += messages
        self._waiting_bytes += sum(len(message.data) for message in messages)

    def _look_at_disk(self, now_s: float) -> None:
        outcome = self._disk.result(now_s)
        if outcome is None:
            return
        self._loading_next = False
        turn, was_thinning = outcome.value, self.thinning
        refused = outcome.error if turn is None else turn.refused
        if refused is None:
            self._forget_saved()
        else:
            self._save_due_s, self._removed = now_s + RETRY_S, 0
        self._log_disk(refused)
        if turn is None:
            return
        self._stored_bytes = turn.stored_bytes
        if self.thinning != was_thinning:
            _log.warning("outbox thinning=%s stored_bytes=%d", self.thinning, self._stored_bytes)
        if turn.outbox_id != self._sender.outbox_id:
            self._sender.begin_life(turn.outbox_id, turn.first)
            self._removed = 0
        elif self._sender.rows is None:
            # Rows that were appended meanwhile wait until those on their way are acknowledged
            self._sender.begin(turn.first, now_s)

    def _log_disk(self, refused: Exception | None) -> None:
        if refused is not None and self._disk_works:
            _log.error("outbox cannot be written, messages wait in memory error=%s", refused)
        elif refused is None and not self._disk_works:
            _log.info("outbox can be written again")
        self._disk_works = refused is None

    def _forget_saved(self) -> None:
        count, dropped = self._handed
        self._handed = (0, {})
        if self._spool is not None:
            self._spool.forget(self._spooled)
        self._waiting_bytes -= sum(len(message.data) for message in self._waiting[:count])
        del self._waiting[:count]
        self._dropped = {source: span for source, span in self._dropped.items() if dropped.get(source) != span}

    def _take_receipts(self, bus: Bus, now_s: float) -> None:
        rows = self._sender.rows
        for receipt in bus.take(RECEIPT):
            self._sender.receive(receipt, now_s)
        if rows is not None and self._sender.rows is None:
            self._next_rows_due = self._stored_bytes > len(rows.data)

    def _save(self, now_s: float) -> None:
        """Hand over what waits, when it is time; what is acknowledged is removed by the way."""
        urgent = self._next_rows_due and self._disk_works
        if self._disk.busy or (now_s < self._save_due_s and not urgent):
            return
        if not (self._waiting or self._dropped) and self._sender.acknowledged == self._removed:
            return
        self._loading_next, self._next_rows_due = self._next_rows_due, False
        self._save_due_s = now_s + ROW_PERIOD_S
        # A disk with little space takes some, where it would take nothing of all
        ends = accumulate(len(message.data) for message in self._waiting)
        within = sum(1 for _ in takewhile(lambda end: end <= SAVE_BYTES_MAX, ends))
        count = min(max(within, 1), len(self._waiting))
        self._handed = (count, dict(self._dropped))
        if self._spool is not None and count == len(self._waiting):
            self._spooled = self._spool.turn()
        self._removed = self._sender.acknowledged
        self._disk.begin(self._work(count), now_s)

    def _work(self, count: int) -> Callable[[], Turn]:
        """What there is to do for the disk, as of now, with so many of the messages that wait."""
        sender = self._sender
        batch = Batch(
            self._waiting[:count],
            dict(self._dropped),
            dict(self._received),
            sender.outbox_id,
            sender.acknowledged,
            load=sender.rows is None,
        )
        return lambda: self._store.turn(batch)
