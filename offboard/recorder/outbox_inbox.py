"""Pieces of the robot's outbox -> rows of messages, each once and in order; says what it wants next. Pure."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import msgpack

from common.frames import MESSAGE_BYTES_MAX, Frame, Losses
from common.messages import OutboxPiece, OutboxReceipt
from offboard.recorder.run_schema import Delivery

TOTAL_BYTES_MAX = 2 * MESSAGE_BYTES_MAX

_log = logging.getLogger("recorder")


class OutboxInbox:
    """What came of the rows that are on their way. Rows that wait for the disk keep everything else out."""

    def __init__(self, next_rows: Mapping[int, int]) -> None:
        """`next_rows`: outbox id -> the first row of it that the database does not hold."""
        self.complete: OutboxPiece | None = None  # the last piece of rows that are all here, not yet stored
        self._next_rows = dict(next_rows)
        self._newest: OutboxPiece | None = None
        self._bytes = bytearray()

    def take(self, piece: OutboxPiece) -> None:
        """A piece that does not continue what is here is left out: the receipt says what is wanted."""
        if self.complete is not None or not 0 < piece.total_bytes <= TOTAL_BYTES_MAX:
            return
        same = self._newest is not None and _rows_of(self._newest) == _rows_of(piece)
        if not same:
            self._bytes.clear()
        self._newest = piece
        known = piece.number < self._next_rows.get(piece.outbox_id, 0)
        if known or piece.offset != len(self._bytes) or len(self._bytes) + len(piece.data) > piece.total_bytes:
            return
        self._bytes += piece.data
        if len(self._bytes) == piece.total_bytes:
            self.complete = piece

    def delivery(self, arrived_s: float) -> Delivery:
        """The messages of the rows that are complete; those that the database has already are left out."""
        assert self.complete is not None
        outbox_id = self.complete.outbox_id
        delivery = Delivery(arrived_s, outbox_id=outbox_id, next_row=self.complete.number + 1)
        wanted = self._next_rows.get(outbox_id, 0)
        try:
            for number, row in msgpack.unpackb(self._bytes):
                delivery.next_row = max(delivery.next_row, int(number) + 1)
                if number >= wanted:
                    _add_row(delivery, row)
        except (ValueError, TypeError, msgpack.UnpackException) as error:
            # Sent again it would be the same: kept waiting, it would keep all later ones out
            _log.error("rows of the outbox make no sense row=%d error=%s", self.complete.number, error)
        return delivery

    def stored(self, delivery: Delivery) -> None:
        """The database has them."""
        assert delivery.outbox_id is not None
        self._next_rows[delivery.outbox_id] = delivery.next_row
        self._bytes.clear()
        self.complete = None

    def receipt(self, now_s: float) -> OutboxReceipt | None:
        """What is wanted next of the outbox that spoke last; None while none did."""
        newest = self._newest
        if newest is None:
            return None
        number = self._next_rows.get(newest.outbox_id, 0)
        if number > newest.number:
            return OutboxReceipt(now_s, newest.outbox_id, number)
        return OutboxReceipt(now_s, newest.outbox_id, newest.number, len(self._bytes), newest.total_bytes)


def _rows_of(piece: OutboxPiece) -> tuple[int, int, int]:
    return piece.outbox_id, piece.number, piece.total_bytes


def _add_row(delivery: Delivery, row: bytes) -> None:
    messages, losses = msgpack.unpackb(row)
    frames = [Frame(str(key), int(boot_id), int(sequence), bytes(data)) for key, boot_id, sequence, data in messages]
    dropped: Losses = {(str(key), int(boot_id)): int(count) for key, boot_id, count in losses}
    delivery.frames += frames
    for source, count in dropped.items():
        delivery.dropped[source] = delivery.dropped.get(source, 0) + count
