"""The outbox of comm: every recorded message of the robot's modules -> `OUTBOX`, until `RECEIPT` (CM_MR_01).

Messages wait in RAM for at most ROW_PERIOD_S, then on the disk, and leave it when the recorder says that its database
has them. At most AHEAD_BYTES are on their way at a time: a photo takes its turn and never fills the link.
Whatever is killed or cut off, sender, rows and pieces have numbers, so that everything ends up in the database once.

Above its limit on the disk only status and log thin out, to one message in THINNED_TO. What had to be dropped is
counted per sender and travels with the rows.
"""

from __future__ import annotations

import logging
from pathlib import Path

from common.bus import Bus
from common.disk_worker import DiskWorker
from common.frames import Frame, Losses
from common.messages import LOG, OUTBOX, RECEIPT, ROBOT_RECORDED, STATUS, OutboxPiece, OutboxReceipt
from onboard.comm.last_words import LastWords
from onboard.comm.outbox_store import OutboxStore, Rows, Turn, open_store

ROW_PERIOD_S = 0.25
PIECE_BYTES = 64_000
AHEAD_BYTES = 2 * PIECE_BYTES  # on their way at a time: at 2 MB/s they hold up what lives by 64 ms at most
RESEND_S = 0.5  # without progress; doubled each time, or what is late on a slow link would be sent again and again
RESEND_MAX_S = 4.0
RECEIPT_SILENCE_S = 1.5  # a receipt after so long: the link, or the recorder, is back
RETRY_S = 1.0  # after the disk refused
WAITING_BYTES_MAX = 8_000_000  # in RAM, while the disk does not take them
THINNED_TO = 10

FILE_NAME = "outbox.sqlite"
_THINNED = frozenset(topic.key for table in (STATUS, LOG) for topic in table.values())

# The recorder stores its own itself; what it could not, being killed, is here
_OF_RECORDER = (STATUS["recorder"], LOG["recorder"])
_RECORDER_KEYS = frozenset(topic.key for topic in _OF_RECORDER)

_log = logging.getLogger("comm")


class Outbox:
    """Part of comm: `step` in every step of it, `close` at its end. No step waits for the disk."""

    def __init__(self, file: Path | None, limit_bytes: int, new_id: int | None = None) -> None:
        """`new_id`: for lockstep, where the disk's work is done at once and in order."""
        self._store: OutboxStore = open_store(file, new_id)
        self._limit_bytes = limit_bytes
        self._disk: DiskWorker[Turn] = DiskWorker("outbox", at_once=new_id is not None)
        self._tapped = False
        self._last_words = LastWords(_RECORDER_KEYS)
        self._heard = dict(self._store.heard)
        self._waiting: list[Frame] = []
        self._waiting_bytes = 0
        self._dropped: Losses = {}
        self._saving: tuple[list[Frame], Losses] = ([], {})  # handed to the disk, not known to be there
        self._save_due_s = float("-inf")
        self._next_rows_due = False  # more lies on the disk: no need to wait for the period
        self._disk_works = True
        turn = self._store.look()
        self._stored_bytes, self._rows = turn.stored_bytes, turn.first
        self._acknowledged = self._removed = 0  # all rows before this one
        self._receipt: OutboxReceipt | None = None
        self._offset = self._held = 0  # bytes of the rows that were sent, and that the recorder says it has
        self._resend_due_s = float("-inf")
        self._resend_pause_s = RESEND_S
        self._receipt_heard_s = float("-inf")
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
        if not self._tapped:
            bus.tap((*ROBOT_RECORDED, *_OF_RECORDER), self._heard)
            self._tapped = True
        self._collect(bus)
        self._look_at_disk(now_s)
        self._hear_receipt(bus, now_s)
        self._save(now_s)
        self._send_data(bus, now_s)

    def close(self) -> None:
        """What still waits goes onto the disk, for the next life."""
        outcome = self._disk.close()
        if outcome is not None and outcome.value is not None:
            self._saving = ([], {})
        frames, dropped = self._to_save()
        if (frames or dropped) and self._disk_works:
            closing: DiskWorker[Turn] = DiskWorker("outbox", at_once=True)
            closing.begin(lambda: self._store.turn(frames, dropped, self._heard, self._acknowledged))
        self._store.close()

    def _collect(self, bus: Bus) -> None:
        # What does not fit stays with the bus, and with the producers beyond that
        if self._waiting_bytes > WAITING_BYTES_MAX:
            return
        thinning = self.thinning
        for frame in bus.take_frames():
            source = (frame.key, frame.boot_id)
            if frame.key in _RECORDER_KEYS:
                self._waiting += self._last_words.hear(frame)
                continue
            self._heard[source] = frame.sequence
            if thinning and frame.key in _THINNED and frame.sequence % THINNED_TO:
                self._dropped[source] = self._dropped.get(source, 0) + 1
                continue
            self._waiting.append(frame)
            self._waiting_bytes += len(frame.data)
        for source, count in bus.take_lost().items():
            if source[0] in _RECORDER_KEYS:
                continue
            _log.warning("messages were lost before the outbox topic=%s count=%d", source[0], count)
            self._dropped[source] = self._dropped.get(source, 0) + count

    def _look_at_disk(self, now_s: float) -> None:
        outcome = self._disk.outcome()
        if outcome is None:
            return
        if outcome.value is None:
            if self._disk_works:
                _log.error("outbox cannot be written, messages wait in memory error=%s", outcome.error)
            self._disk_works = False
            self._save_due_s, self._removed = now_s + RETRY_S, 0
            return
        if not self._disk_works:
            _log.info("outbox can be written again")
            self._disk_works = True
        self._saving = ([], {})
        was_thinning = self.thinning
        self._stored_bytes = outcome.value.stored_bytes
        if self.thinning != was_thinning:
            _log.warning("outbox thinning=%s stored_bytes=%d", self.thinning, self._stored_bytes)
        # Rows that were appended meanwhile wait until those on their way are acknowledged
        if self._rows is None:
            self._rows, self._offset, self._held = outcome.value.first, 0, 0
            self._resend_due_s, self._resend_pause_s = now_s + RESEND_S, RESEND_S

    def _hear_receipt(self, bus: Bus, now_s: float) -> None:
        receipt, rows = bus.latest(RECEIPT), self._rows
        if receipt is None or receipt is self._receipt or receipt.outbox_id != self._store.outbox_id:
            return
        if now_s - self._receipt_heard_s > RECEIPT_SILENCE_S:
            self._resend_due_s, self._resend_pause_s = min(self._resend_due_s, now_s), RESEND_S
        self._receipt, self._receipt_heard_s = receipt, now_s
        if rows is None:
            return
        if receipt.number > rows.number:
            self._acknowledged, self._rows = receipt.number, None
            if self._stored_bytes > len(rows.data):
                self._next_rows_due = True
        elif self._held_by_recorder(rows) > self._held:
            self._held = self._held_by_recorder(rows)
            self._offset = max(self._offset, self._held)
            self._resend_pause_s = RESEND_S
            self._resend_due_s = now_s + RESEND_S

    def _held_by_recorder(self, rows: Rows) -> int:
        """How many bytes of these rows the recorder says it has in hand."""
        receipt = self._receipt
        same = receipt is not None and (receipt.number, receipt.total_bytes) == (rows.number, len(rows.data))
        return receipt.offset if receipt is not None and same else 0

    def _to_save(self) -> tuple[list[Frame], Losses]:
        frames, dropped = self._saving
        dropped = dict(dropped)
        for source, count in self._dropped.items():
            dropped[source] = dropped.get(source, 0) + count
        return [*frames, *self._waiting], dropped

    def _save(self, now_s: float) -> None:
        """Hand over what waits, when it is time; what is acknowledged is removed by the way."""
        urgent = self._next_rows_due and self._disk_works
        if self._disk.busy or (now_s < self._save_due_s and not urgent):
            return
        frames, dropped = self._to_save()
        if not (frames or dropped) and self._acknowledged == self._removed:
            return
        self._saving = (frames, dropped)
        self._waiting, self._waiting_bytes, self._dropped = [], 0, {}
        self._save_due_s, self._next_rows_due = now_s + ROW_PERIOD_S, False
        heard, acknowledged = dict(self._heard), self._acknowledged
        self._removed = acknowledged
        load = self._rows is None
        self._disk.begin(lambda: self._store.turn(frames, dropped, heard, acknowledged, load=load))

    def _send_data(self, bus: Bus, now_s: float) -> None:
        """At most one piece per step, and at most AHEAD_BYTES beyond what the recorder says it has."""
        rows = self._rows
        if rows is None:
            return
        if now_s >= self._resend_due_s:  # no progress: pieces were lost, or the recorder was restarted
            held = self._held_by_recorder(rows)
            # All of it in hand, and still no receipt: a recorder that died with it must hear something to answer
            self._offset = self._held = held if held < len(rows.data) else 0
            self._resend_pause_s = min(2 * self._resend_pause_s, RESEND_MAX_S)
            self._resend_due_s = now_s + self._resend_pause_s
        if self._offset >= len(rows.data) or self._offset - self._held >= AHEAD_BYTES:
            return
        piece = rows.data[self._offset : self._offset + PIECE_BYTES]
        message = OutboxPiece(now_s, self._store.outbox_id, rows.number, self._offset, len(rows.data), piece)
        bus.publish(OUTBOX, message)
        self._offset += len(piece)
