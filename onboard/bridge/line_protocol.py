"""Lines of the serial line <-> messages of `protocol`: SENDER_RECEIVER_TIME_MESSAGE*CRC and a newline.

A newline always resynchronises, so that garbage costs one line. What is damaged is counted and dropped, never guessed.
"""

from __future__ import annotations

import binascii
import re
from itertools import islice
from operator import le
from typing import NamedTuple

from onboard.bridge.protocol import LAYOUT, MAX_LINE, Message

_FRAME = re.compile(rb"([A-Z]{2,3})_([A-Z]{2,3})_(0|[1-9]\d{0,9})_([A-Z]+)((?:,-?\d{1,10})*)\*([0-9A-F]{4})")
_PREFIX = {kind: (f"{sender}_{receiver}_", name) for kind, (sender, receiver, name, _) in LAYOUT.items()}
_TIME_MODULUS = 1 << 32


class _Form(NamedTuple):
    """How the numbers of a line become a message."""

    kind: type[Message]
    minima: tuple[int, ...]  # of every number
    maxima: tuple[int, ...]
    lengths: tuple[int, ...]  # numbers in each field; empty where every field is one number


def _form(kind: type[Message]) -> _Form:
    fields = LAYOUT[kind][3]
    lengths = tuple(field.length for field in fields)
    minima = tuple(field.minimum for field in fields for _ in range(field.length))
    maxima = tuple(field.maximum for field in fields for _ in range(field.length))
    return _Form(kind, minima, maxima, lengths if max(lengths) > 1 else ())


_BY_HEADER = {tuple(word.encode() for word in layout[:3]): _form(kind) for kind, layout in LAYOUT.items()}


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
    form = _BY_HEADER.get((frame[1], frame[2], frame[4]))
    if form is None:
        return None
    numbers = [int(number) for number in frame[5].split(b",")[1:]]
    if len(numbers) != len(form.minima):
        return None
    if not (all(map(le, form.minima, numbers)) and all(map(le, numbers, form.maxima))):
        return None
    rest = iter(numbers)
    values = [next(rest) if n == 1 else tuple(islice(rest, n)) for n in form.lengths] or numbers
    message: Message = form.kind._make(values)
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
