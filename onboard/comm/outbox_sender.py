"""Rows of the outbox on their way: pieces of them to one recorder -> its receipts. Pure.

At most AHEAD_BYTES are on their way at a time: a photo takes its turn and never fills the link. Rows go to one recorder
at a time, or each of two would lose what the other acknowledged: the first that answers, until it has been silent for
OWNER_SILENCE_S.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from common.messages.delivery import OutboxPiece, OutboxReceipt
from common.messages.topics import RECEIPT
from common.undecodable import Undecodable
from onboard.comm.outbox_store import Rows

PIECE_BYTES = 64_000
AHEAD_BYTES = 2 * PIECE_BYTES  # on their way at a time: at 2 MB/s they hold up what lives by 64 ms at most
RESEND_S = 0.5  # without progress; doubled each time, or what is late on a slow link would be sent again and again
RESEND_MAX_S = 4.0
RECEIPT_SILENCE_S = 1.5  # a receipt after so long: the link, or the recorder, is back
OWNER_SILENCE_S = 5.0

_log = logging.getLogger("comm")


@dataclass(slots=True)
class _Reached:
    """Of the rows on their way, in bytes."""

    offset: int = 0  # where to go on
    sent: int = 0  # how far anything was sent
    held: int = 0  # the most that the recorder reported
    reported: int = 0  # what it reported last: a recorder that was restarted has nothing


class OutboxSender:
    """For one life of the outbox after the other."""

    def __init__(self, outbox_id: int, rows: Rows | None) -> None:
        self._refused = Undecodable("receipt refused")
        self._owner: int | None = None
        self._owner_received_s = float("-inf")
        self._resend_due_s = float("-inf")
        self._resend_pause_s = RESEND_S
        self.begin_life(outbox_id, rows)

    def begin_life(self, outbox_id: int, rows: Rows | None) -> None:
        self.outbox_id, self.rows = outbox_id, rows
        self.acknowledged = 0  # all rows before this one, of this life
        self._reached = _Reached()

    def begin(self, rows: Rows | None, now_s: float) -> None:
        """What comes after the rows that were acknowledged."""
        self.rows = rows
        self._reached = _Reached()
        self._resend_due_s, self._resend_pause_s = now_s + RESEND_S, RESEND_S

    def receive(self, receipt: OutboxReceipt, now_s: float) -> None:
        if receipt.outbox_id != self.outbox_id or not self._is_from_owner(receipt, now_s):
            return
        if now_s - self._owner_received_s > RECEIPT_SILENCE_S:
            self._resend_due_s, self._resend_pause_s = min(self._resend_due_s, now_s), RESEND_S
        self._owner_received_s = now_s
        rows = self.rows
        if rows is None or receipt.number < rows.number:
            return
        if not self._can_be(receipt, rows):
            self._refused.count(RECEIPT.key, f"row {receipt.number} offset {receipt.offset} was not sent yet")
        elif receipt.number == rows.end:
            self.acknowledged, self.rows = rows.end, None
        elif receipt.total_bytes == len(rows.data):
            self._progress(receipt.offset, now_s)

    @property
    def unsent(self) -> bool:
        """A part of the rows was not sent yet."""
        return self.rows is not None and self._reached.offset < len(self.rows.data)

    @property
    def due_s(self) -> float:
        """When something is to be sent again (s)."""
        return self._resend_due_s if self.rows is not None else float("inf")

    def is_answered(self, now_s: float) -> bool:
        """A recorder was there just now."""
        return now_s - self._owner_received_s <= RECEIPT_SILENCE_S

    def pieces(self, now_s: float) -> Iterator[OutboxPiece]:
        """All that may be sent now."""
        while (piece := self._piece(now_s)) is not None:
            yield piece

    def _piece(self, now_s: float) -> OutboxPiece | None:
        rows, reached = self.rows, self._reached
        if rows is None:
            return None
        if now_s >= self._resend_due_s:  # no progress: pieces were lost, or the recorder was restarted
            # The recorder has all bytes, but no receipt came: if it was restarted, only a message makes it reply
            reached.offset = reached.held = reached.reported if reached.reported < len(rows.data) else 0
            self._resend_pause_s = min(2 * self._resend_pause_s, RESEND_MAX_S)
            self._resend_due_s = now_s + self._resend_pause_s
        if reached.offset >= len(rows.data) or reached.offset - reached.held >= AHEAD_BYTES:
            return None
        data = rows.data[reached.offset : reached.offset + PIECE_BYTES]
        place = (self.outbox_id, rows.number, reached.offset, len(rows.data))
        reached.offset += len(data)
        reached.sent = max(reached.sent, reached.offset)
        return OutboxPiece(now_s, *place, data, recorder_id=self._owner or 0)

    def _is_from_owner(self, receipt: OutboxReceipt, now_s: float) -> bool:
        recorder_id = receipt.recorder_id
        if recorder_id == self._owner:
            return True
        if now_s - self._owner_received_s <= OWNER_SILENCE_S:
            self._refused.count(RECEIPT.key, f"recorder {recorder_id} is a second one, rows go to {self._owner} alone")
            return False
        _log.info("rows go to recorder=%d", recorder_id)
        if self._owner is not None:
            self._reached = _Reached(sent=self._reached.sent)
        self._owner = recorder_id
        return True

    def _can_be(self, receipt: OutboxReceipt, rows: Rows) -> bool:
        sent = self._reached.sent
        if receipt.number == rows.number:
            return 0 <= receipt.offset <= sent
        return receipt.number == rows.end and sent == len(rows.data)

    def _progress(self, held: int, now_s: float) -> None:
        reached = self._reached
        reached.reported = held
        if held > reached.held:
            reached.held = held
            reached.offset = max(reached.offset, held)
            self._resend_due_s, self._resend_pause_s = now_s + RESEND_S, RESEND_S
