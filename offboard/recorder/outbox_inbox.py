"""Pieces of the robot's outbox -> its rows, each once and in order, and what is wanted next. Pure."""

from __future__ import annotations

from common.messages.delivery import OutboxPiece, OutboxReceipt
from common.zenoh_channel import MESSAGE_BYTES_MAX

TOTAL_BYTES_MAX = 2 * MESSAGE_BYTES_MAX
HANDOVER_S = 10.0  # longer than the outbox waits for a recorder that has ended


class OutboxInbox:
    """What came of the rows that are in transit. Rows that wait for the disk keep everything else out.

    Numbers of rows count for one life of the outbox: of another one nothing is known. What comes twice, the database
    knows by its messages.
    """

    def __init__(self, recorder_id: int) -> None:
        self.recorder_id = recorder_id
        self.complete: OutboxPiece | None = None  # the last piece of rows that are all here, not yet stored
        self._another_since_s: float | None = None  # the rows in transit go to another recorder
        self._newest_s = float("-inf")
        self._next_row = 0  # of the newest piece's outbox: the first that is not stored yet
        self._newest: OutboxPiece | None = None
        self._bytes = bytearray()

    def another_is_served(self, now_s: float) -> bool:
        """The outbox sends to another recorder, and it is no mere leftover from before that one ended."""
        since_s = self._another_since_s
        return since_s is not None and now_s - since_s > HANDOVER_S and now_s - self._newest_s < HANDOVER_S

    def take(self, piece: OutboxPiece, now_s: float) -> None:
        """A piece that does not continue what is here is left out: the receipt requests what is wanted."""
        if self.complete is not None or not 0 < piece.total_bytes <= TOTAL_BYTES_MAX:
            return
        if self._newest is None or self._newest.outbox_id != piece.outbox_id:
            self._next_row = 0
        for_another = piece.recorder_id not in (0, self.recorder_id)
        if not for_another:
            self._another_since_s = None
        elif self._another_since_s is None:
            self._another_since_s = now_s
        same = self._newest is not None and _rows_of(self._newest) == _rows_of(piece)
        if for_another or not same:
            self._bytes.clear()
        self._newest, self._newest_s = piece, now_s
        unwanted = for_another or piece.number < self._next_row or piece.offset != len(self._bytes)
        if unwanted or len(self._bytes) + len(piece.data) > piece.total_bytes:
            return
        self._bytes += piece.data
        if len(self._bytes) == piece.total_bytes:
            self.complete = piece

    def rows(self) -> bytes:
        """Those that are complete, for `unpack_rows`; none while there are none."""
        return bytes(self._bytes) if self.complete is not None else b""

    def stored(self, newest_row: int) -> None:
        """The database has the rows that were complete; `newest_row` as `unpack_rows` returns it."""
        assert self.complete is not None
        self._next_row = max(self.complete.number, newest_row) + 1
        self._bytes.clear()
        self.complete = None

    def receipt(self, now_s: float) -> OutboxReceipt | None:
        """What is wanted next of the outbox that sent last; None while none did."""
        newest = self._newest
        if newest is None:
            return None
        if self._next_row > newest.number:
            return OutboxReceipt(now_s, newest.outbox_id, self._next_row, recorder_id=self.recorder_id)
        place = (newest.outbox_id, newest.number, len(self._bytes), newest.total_bytes)
        return OutboxReceipt(now_s, *place, recorder_id=self.recorder_id)


def _rows_of(piece: OutboxPiece) -> tuple[int, int, int]:
    return piece.outbox_id, piece.number, piece.total_bytes
