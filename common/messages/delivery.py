"""The outbox: pieces of the run database on their way to the recorder, and its receipts."""

from __future__ import annotations

from dataclasses import dataclass

from common.fields import Count, Identity, Piece, RowsBytes, Seconds


@dataclass(frozen=True, slots=True)
class OutboxPiece:
    """A part of the rows of comm's outbox from row `number` on: bytes `offset`.. of `total_bytes`.

    `outbox_id` is new whenever the outbox is opened: row numbers mean nothing beyond that.
    """

    t_s: Seconds
    outbox_id: Identity
    number: Count
    offset: RowsBytes
    total_bytes: RowsBytes
    data: Piece
    valid: bool = True
    recorder_id: Identity = 0  # the recorder that it is for; 0: the first that replies


@dataclass(frozen=True, slots=True)
class OutboxReceipt:
    """All rows before `number` are in the run database; of those sent from there on it holds `offset` bytes so far."""

    t_s: Seconds
    outbox_id: Identity
    number: Count
    offset: RowsBytes = 0
    total_bytes: RowsBytes = 0
    valid: bool = True
    recorder_id: Identity = 0
