"""Messages from the message table by chance: sound ones up to the bounds of every field, and ones that are not."""

from __future__ import annotations

import dataclasses
import random
import zlib
from enum import Enum
from functools import cache
from math import inf, nan
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgpack
import numpy as np
import numpy.typing as npt

from common.codec import CODEC_VERSION
from common.fields import GRID_CELLS_MAX, Shape, UpTo, Within
from common.messages.mapping import GridUpdate

P = TypeVar("P")

TEXTS = (
    "",
    "x",
    "INFO",
    "operator",
    "[/a]",
    "[red]x[/]",
    "%s {0}",
    "../../etc",
    "\N{SNOWMAN}\N{COMBINING DIAERESIS}",
    "'\"<&>",
)
RAW_TEXTS = ("\x1b]0;title\x07\x1b[2J", "two\nlines\r\0", "\u202eturned\u2066", "\x9b31m")
BOMB = zlib.compress(bytes(50_000_000))
POISONS: tuple[Any, ...] = (
    *(nan, inf, -inf, 1e308, -0.0, 5e-324),
    *(2**64 - 1, 2**63, -(2**63), 2**53, -1, 0),
    *(
        None,
        True,
        "text",
        "\x1b[2J",
        b"bytes",
        BOMB,
        b"",
        [],
        [nan],
        [[]] * 9,
        ["x"] * 500,
        {},
        {"a": {"b": []}},
        "x" * 100_000,
    ),
)
_LONGEST_SHARE = 0.005
_RARE_GRID = 0.05  # as large as the codec lets through
UNLIMITED = 2**40


def packed(array: npt.NDArray[Any]) -> msgpack.ExtType:
    return msgpack.ExtType(1, msgpack.packb([array.dtype.str, list(array.shape), array.tobytes()]))


_POISONED_ARRAYS = (
    *(packed(np.full(shape, nan, np.float32)) for shape in ((3, 2), (3,), (0, 2), (2, 2, 2))),
    *(packed(np.zeros((3, 2), kind)) for kind in ("f8", "i8", "u1", "U4", "M8[s]", ">f4")),
    msgpack.ExtType(1, msgpack.packb(["<f4", [2**40, 2], b""])),
    msgpack.ExtType(1, msgpack.packb(["O", [1], b"12345678"])),
    msgpack.ExtType(9, b"unknown"),
)


@cache
def _hints(payload: type) -> dict[str, Any]:
    hints = get_type_hints(payload, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(payload)}


def fit(payload: type[P], chance: random.Random, longest: int = UNLIMITED, longest_share: float = _LONGEST_SHARE) -> P:
    """A sound payload; its values are ordinary, at their bounds, or anything between.

    `longest_share`: of its arrays and bytes that are as long as the codec accepts, or as `longest` says.
    """
    lengths = _Lengths(chance, longest, longest_share)
    values = {name: _value(hint, chance, lengths) for name, hint in _hints(payload).items()}
    if payload is GridUpdate:
        values |= _floor(chance)
    return payload(**values)


def _floor(chance: random.Random) -> dict[str, Any]:
    """Cells that fill their rows and columns: noise, or large pieces of one kind."""
    rows, columns = (chance.choice((1, 7, 60, 90, 200)) for _ in range(2))
    if chance.random() < _RARE_GRID:
        rows = chance.choice((200, 2_000, 20_000))
        columns = GRID_CELLS_MAX // rows
    numbers = np.random.default_rng(chance.getrandbits(32))
    coarse = chance.choice((1, 4, 30))
    cells = numbers.integers(0, 3, (rows // coarse + 1, columns // coarse + 1), np.uint8)
    cells = np.kron(cells, np.ones((coarse, coarse), np.uint8))[:rows, :columns]
    return {"rows": rows, "columns": columns, "cells_zlib": zlib.compress(cells.tobytes(), 1)}


def _value(hint: Any, chance: random.Random, lengths: _Lengths) -> Any:
    kind, *said = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    notes = {type(note): note for note in said}
    if kind is bool:
        return chance.random() < 0.5
    if kind in (int, float):
        return _number(kind, notes[Within], chance)
    if kind in (str, bytes):
        length_max = notes[UpTo].count
        if kind is str:
            return chance.choice(("x" * length_max, *TEXTS))[:length_max]
        return chance.randbytes(lengths.draw(length_max))
    if get_origin(kind) is None:
        return chance.choice(list(kind))
    first, *others = notes[Shape].sizes
    length = first if isinstance(first, int) else lengths.of(first, notes[UpTo].count)
    if get_origin(kind) is tuple:
        return tuple(_value(get_args(kind)[0], chance, lengths) for _ in range(length))
    (dtype,) = get_args(get_args(kind)[1])
    within = notes[Within]
    numbers = np.random.default_rng(chance.getrandbits(32)).uniform(0.0, 1.0, (length, *others))
    low, high = chance.choice(((within.low, within.high), (max(within.low, -20.0), min(within.high, 20.0))))
    return np.round(low + (high - low) * numbers).astype(dtype)


def _number(kind: type, within: Within, chance: random.Random) -> Any:
    low, high = within.low, min(within.high, 1e12 if kind is float else within.high)
    ordinary = chance.uniform(max(low, -10.0), min(high, 10.0))
    choices: list[Any] = [ordinary, ordinary, ordinary, low, within.high, min(max(0, low), high)]
    choices += [chance.uniform(low, high) if kind is float else chance.randint(low, high)]
    choices += [nan] if within.or_nan else []
    return kind(chance.choice(choices)) if kind is float else int(chance.choice(choices))


class _Lengths:
    """Of what is long, in one message: a letter stands for one length."""

    def __init__(self, chance: random.Random, longest: int, longest_share: float) -> None:
        self._chance, self._longest, self._longest_share = chance, longest, longest_share
        self._drawn: dict[str, int] = {}

    def of(self, letter: str, most: int) -> int:
        if letter not in self._drawn:
            self._drawn[letter] = self.draw(most)
        return self._drawn[letter]

    def draw(self, most: int) -> int:
        longest = self._chance.random() < self._longest_share
        return min(most, self._longest if longest else self._chance.choice((0, 1, 2, 5, 5, 300)))


def body_of(payload: Any) -> dict[str, Any]:
    """Its fields as they travel."""
    return {field.name: _travels(getattr(payload, field.name)) for field in dataclasses.fields(payload)}


def _travels(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return packed(value)
    return value.value if isinstance(value, Enum) else value


def message(body: Any, sequence: Any = 1, boot_id: Any = 1, version: Any = CODEC_VERSION) -> bytes:
    return bytes(msgpack.packb([version, sequence, boot_id, body]))


def poisoned(payload: type, chance: random.Random, sequence: int, boot_id: int, longest: int = UNLIMITED) -> bytes:
    """A message that can be unpacked, with something in it that most often must not be there."""
    body = body_of(fit(payload, chance, longest))
    if chance.random() < 0.05:
        stamp = chance.choice([(nan, 1), (-1, 1), (2**63, 1), (1, -1), (1, 2**64 - 1), ("1", 1), (1, None), ([], {})])
        return message(body, *stamp)
    if chance.random() < 0.03:
        return message(chance.choice(POISONS), sequence, boot_id, chance.choice((CODEC_VERSION, 2, None, "1")))
    for name in chance.sample(sorted(body), min(len(body), chance.choice((1, 1, 1, 2, 9)))):
        old, kind = body[name], chance.random()
        if kind < 0.1:
            del body[name]
        elif isinstance(old, msgpack.ExtType):
            body[name] = chance.choice((*_POISONED_ARRAYS, *POISONS))
        elif isinstance(old, tuple) and old and kind < 0.7:
            body[name] = [*old[1:], chance.choice(POISONS)]
        elif isinstance(old, str) and kind < 0.7:
            body[name] = chance.choice(RAW_TEXTS) * chance.choice((1, 1, 1, 200))
        else:
            body[name] = chance.choice(POISONS)
    if chance.random() < 0.1:
        body["unknown"] = chance.choice(POISONS)
    return message(body, sequence, boot_id)
