"""Lines of the serial line <-> messages of `protocol`: SENDER_RECEIVER_TIME_MESSAGE*CRC and a newline.

A newline always resynchronises, so that garbage costs one line. What is damaged is counted and dropped, never guessed.
"""

from __future__ import annotations

import binascii
import re
from typing import NamedTuple

from onboard.bridge.protocol import LAYOUT, MAX_LINE, Message

_FRAME = re.compile(rb"([A-Z]{2,3})_([A-Z]{2,3})_(0|[1-9]\d{0,9})_([A-Z]+)((?:,-?\d{1,10})*)\*([0-9A-F]{4})")
_BY_HEADER = {layout[:3]: (kind, layout[3]) for kind, layout in LAYOUT.items()}
_PREFIX = {kind: (f"{sender}_{receiver}_", name) for kind, (sender, receiver, name, _) in LAYOUT.items()}
_TIME_MODULUS = 1 << 32


class Received(NamedTuple):
    """A valid line: the time of measurement by its sender's clock, and the message."""

    time_ms: int
    message: Message


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, begun with 0xFFFF; "123456789" gives 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def encode(message: Message, time_ms: int) -> bytes:
    """The line of a message, `time_ms` being the sender's time; it wraps at 32 bits."""
    prefix, name = _PREFIX[type(message)]
    values: list[int] = []
    for value in message:
        values.extend(value if isinstance(value, tuple) else (value,))
    body = ",".join((name, *map(str, values)))
    text = f"{prefix}{time_ms % _TIME_MODULUS}_{body}".encode("ascii")
    return b"%s*%04X\n" % (text, crc16(text))


def decode(line: bytes) -> Received | None:
    """The message in a line without its newline, or None when it is damaged, unknown or out of range."""
    frame = _FRAME.fullmatch(line)
    if frame is None or crc16(line[:-5]) != int(frame[6], 16):
        return None
    kind, fields = _BY_HEADER.get((frame[1].decode(), frame[2].decode(), frame[4].decode()), (None, ()))
    if kind is None:
        return None
    numbers = [int(number) for number in frame[5].split(b",")[1:]]
    if len(numbers) != sum(field.length for field in fields):
        return None
    values: list[int | tuple[int, ...]] = []
    at = 0
    for field in fields:
        part = numbers[at : at + field.length]
        at += field.length
        if min(part) < field.minimum or max(part) > field.maximum:
            return None
        values.append(part[0] if field.length == 1 else tuple(part))
    message: Message = kind(*values)  # type: ignore[arg-type]
    return Received(int(frame[3]), message)


class LineDecoder:
    """Bytes as they come -> valid lines; `bad_lines` counts the others."""

    def __init__(self) -> None:
        self._rest = b""
        self._overlong = False
        self.bad_lines = 0

    def feed(self, data: bytes) -> list[Received]:
        """The lines that these bytes complete, in order."""
        *lines, rest = (self._rest + data).split(b"\n")
        received = []
        for line in lines:
            message = None if self._overlong else decode(line)
            self._overlong = False
            if message is not None:
                received.append(message)
            elif line:
                self.bad_lines += 1
        self._overlong = self._overlong or len(rest) >= MAX_LINE
        self._rest = rest[:MAX_LINE]
        return received
