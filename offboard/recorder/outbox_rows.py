"""Rows of the robot's outbox as they travel together -> their messages. Pure."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

import msgpack

from common.codec import DecodeError, read_header
from common.recording import Losses, RecordedMessage, add_loss

_SENSELESS = (ValueError, TypeError, DecodeError, msgpack.UnpackException)

_log = logging.getLogger("recorder")


@dataclass(slots=True)
class RowContent:
    """The messages of some rows, and what was dropped before them; `newest` is the largest number of a row."""

    newest: int = 0
    messages: list[RecordedMessage] = field(default_factory=list)
    dropped: Losses = field(default_factory=dict)


def unpack_rows(data: bytes) -> RowContent:
    """What makes no sense is left out, with a line in the log."""
    content = RowContent()
    try:
        for number, row in _rows_in(data):
            content.newest = max(content.newest, number)
            _add_row(content, row)
    except _SENSELESS as error:
        _log.error("rows of the outbox make no sense error=%s", error)
    return content


def _rows_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    if not data:
        return
    # One after the other: a list of millions of empty rows would fill the memory
    unpacker = msgpack.Unpacker(max_buffer_size=len(data))
    unpacker.feed(data)
    for _ in range(unpacker.read_array_header()):
        number, row = unpacker.unpack()
        if not isinstance(row, bytes):
            raise ValueError("a row is no bytes")
        yield _whole(number), row


def _add_row(content: RowContent, row: bytes) -> None:
    try:
        messages, losses = msgpack.unpackb(row)
        for key, *_, data in messages:
            sequence, boot_id = read_header(data)
            content.messages.append(RecordedMessage(str(key), boot_id, sequence, data))
        for key, boot_id, *span in losses:
            if len(span) == 2:  # an older outbox counted them only: the hole in the numbers shows them
                add_loss(content.dropped, (str(key), _whole(boot_id)), *map(_whole, span))
    except _SENSELESS as error:
        # Sending it again would not help, and waiting for it would block all later rows
        _log.error("a row of the outbox makes no sense error=%s", error)


def _whole(value: object) -> int:
    """A number as a database holds it."""
    if type(value) is not int or not 0 <= value < 2**63:
        raise ValueError(f"{value!r} is no number")
    return value
