"""Payload <-> MessagePack, and the universal text form of the specification.

On the wire a message is `[CODEC_VERSION, sequence, boot_id, {field: value}]`. A field that is missing takes its
default, an unknown one is skipped: programs of neighbouring versions understand each other. Arrays travel as raw bytes.
Whatever a field must not hold by its type (`fields`) is refused, on both ends.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
import reprlib
import threading
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

import msgpack
import numpy as np

from common.field_checks import Field, check_lengths, field_of
from common.modules import CODES

CODEC_VERSION = 1
_ARRAY_EXT = 1
_ARRAY_TYPE = re.compile(r"[<>|][fiu][1248]")  # numbers; no objects, no structures
_FOUR_FIELDS = 0x94  # MessagePack: a list of four
_SMALL_INT_MAX = 0x7F  # the number is its own first byte
_INT_BYTES = {0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8}  # that follow this first byte
_NO_INT = 0xFF
_SEQUENCE_MAX = 2**53
_LARGE_BYTES = 64_000
_CONTAINERS_MAX, _ELEMENTS_MAX = 64, 1024  # lists and maps in a large message, and what is in each
_UNDECODABLE = (
    *(ValueError, TypeError, AttributeError, KeyError, ArithmeticError, MemoryError, RecursionError),
    msgpack.UnpackException,
)

P = TypeVar("P")


class DecodeError(ValueError):
    """These bytes are not a message of that type; the message is one sentence with the reason."""


class Envelope(NamedTuple, Generic[P]):
    """A payload with what the bus stamped on it."""

    payload: P
    sequence: int
    boot_id: int


def _pack_special(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return msgpack.ExtType(_ARRAY_EXT, msgpack.packb([array.dtype.str, list(array.shape), array.tobytes()]))
    if isinstance(value, Enum):
        return value.value
    raise TypeError(f"a {type(value).__name__} cannot travel in a message")


def _unpack(data: bytes, ext_hook: Callable[[int, bytes], Any] = msgpack.ExtType) -> Any:
    if len(data) <= _LARGE_BYTES:
        return msgpack.unpackb(data, ext_hook=ext_hook, use_list=False)
    # A million empty lists are no large message, but they fill the memory
    containers = itertools.count(1)

    def count(container: Any) -> Any:
        if next(containers) > _CONTAINERS_MAX:
            raise DecodeError(f"more than {_CONTAINERS_MAX} lists and maps in it")
        return container

    hooks = {"ext_hook": ext_hook, "list_hook": count, "object_hook": count}
    return msgpack.unpackb(data, use_list=False, max_array_len=_ELEMENTS_MAX, max_map_len=_ELEMENTS_MAX, **hooks)


def _unpack_special(code: int, data: bytes) -> Any:
    if code != _ARRAY_EXT:
        raise DecodeError(f"unknown MessagePack extension {code}")
    dtype, shape, raw = _unpack(data)
    if not _ARRAY_TYPE.fullmatch(dtype):
        raise DecodeError(f"an array of {reprlib.repr(dtype)}")
    return np.frombuffer(raw, dtype=np.dtype(dtype)).reshape(shape)


class _Form(NamedTuple):
    """How a payload class travels; made once, for every message of every process passes here."""

    of_body: Callable[[Mapping[str, Any]], Any]  # fields as they came -> payload
    body_of: Callable[[Any], dict[str, Any]]  # payload -> fields as they go; both raise UnfitValue


class _Forms(dict[type, _Form]):
    def __missing__(self, payload: type) -> _Form:
        form = self[payload] = _make_form(payload)
        return form


_FORMS = _Forms()


def _make_form(payload: type) -> _Form:
    """Two functions written for the class, as `dataclasses` writes its own: a loop over fields takes twice as long."""
    hints = get_type_hints(payload, include_extras=True)
    words: dict[str, Any] = {"payload": payload, "check_lengths": check_lengths, "inf": math.inf}
    of_body, body_of, checks = [], [], []
    alike: dict[str, list[str]] = {}
    for declared in dataclasses.fields(payload):
        name, field = declared.name, field_of(declared.name, hints[declared.name])
        words |= {f"default_{name}": declared.default, f"take_{name}": field.take, f"right_{name}": field.right}
        required = declared.default is dataclasses.MISSING
        absent = f"body['{field.former or name}']" if required else f"default_{name}"
        of_body.append(f"{name} = body['{name}'] if '{name}' in body else {absent}")
        body_of.append(f"{name} = of.{name}")
        checks.append(_check_source(name, field))
        if field.like:
            alike.setdefault(field.like, []).append(name)
    names = [declared.name for declared in dataclasses.fields(payload)]
    checks += [f"check_lengths({', '.join(f'{n}={n}' for n in group)})" for group in alike.values() if len(group) > 1]
    of_body = ["def of_body(body):", *of_body, *checks, f"return payload({', '.join(names)})"]
    body_of = ["def body_of(of):", *body_of, *checks, f"return {{{', '.join(f'{n!r}: {n}' for n in names)}}}"]
    exec("\n ".join(of_body) + "\n" + "\n ".join(body_of), words)
    return _Form(words["of_body"], words["body_of"])


def _check_source(name: str, field: Field) -> str:
    if field.right is None:
        return f"{name} = take_{name}({name})"
    fits = f"type({name}) is right_{name}"
    if field.within is not None:
        inside = f"{field.within.low!r} <= {name} <= {field.within.high!r}"
        fits += f" and ({inside} or {name} != {name})" if field.within.or_nan else f" and {inside}"
    return f"if not ({fits}): {name} = take_{name}({name})"


class _Packers(threading.local):
    """One for each thread: a new one for every message would take and return 256 kB of memory."""

    def __init__(self) -> None:
        self.mine = msgpack.Packer(default=_pack_special)


_packers = _Packers()


def encode(payload: Any, sequence: int, boot_id: int) -> bytes:
    """Bytes of a payload dataclass; raises UnfitValue where a field violates its type or bounds."""
    body = _FORMS[type(payload)].body_of(payload)
    packed: bytes = _packers.mine.pack((CODEC_VERSION, sequence, boot_id, body))
    return packed


def _is_stamp(sequence: Any, boot_id: Any) -> bool:
    return type(sequence) is int and type(boot_id) is int and 0 < sequence < _SEQUENCE_MAX and 0 <= boot_id < 2**63


def decode(data: bytes, payload: type[P]) -> Envelope[P]:
    """The message in `data`; raises DecodeError with one sentence for anything that is none."""
    try:
        version, sequence, boot_id, body = _unpack(data, _unpack_special)
        if version != CODEC_VERSION:
            raise DecodeError(f"message of codec version {reprlib.repr(version)}, this program uses {CODEC_VERSION}")
        if not _is_stamp(sequence, boot_id):
            raise DecodeError("no sequence number and boot id")
        return Envelope(_FORMS[payload].of_body(body), sequence, boot_id)
    except DecodeError:
        raise
    except _UNDECODABLE as error:
        raise DecodeError(f"not a {payload.__name__} message: {error}") from error


def read_header(data: bytes) -> tuple[int, int]:
    """Sequence number and boot id without a look at the rest, whatever its version; raises DecodeError."""
    if len(data) < 4 or data[0] != _FOUR_FIELDS or data[1] > _SMALL_INT_MAX:
        raise DecodeError("no header of a message")
    sequence, at = _read_int(data, 2)
    boot_id, _ = _read_int(data, at)
    if not _is_stamp(sequence, boot_id):
        raise DecodeError("no header of a message")
    return sequence, boot_id


def _read_int(data: bytes, at: int) -> tuple[int, int]:
    """The unsigned number at a place, in any of MessagePack's forms, and where it ends; -1 where there is none."""
    first = data[at] if at < len(data) else _NO_INT
    if first <= _SMALL_INT_MAX:
        return first, at + 1
    end = at + 1 + _INT_BYTES.get(first, len(data))
    return (int.from_bytes(data[at + 1 : end]), end) if end <= len(data) else (-1, end)


def _text_of(value: Any) -> str:
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.3f}"
    if isinstance(value, bytes):
        return f"<{len(value)} bytes>"
    if isinstance(value, np.ndarray):
        return f"<{'x'.join(map(str, value.shape))}>"
    if isinstance(value, tuple):
        return " ".join(_text_of(v) for v in value)
    return str(value)


def as_text(sender: str, receiver: str, payload: Any) -> str:
    """SendingModuleName_ReceivingModuleName_TimeStamp_Message; the time stamp in milliseconds of the sender's clock."""
    names = [field.name for field in dataclasses.fields(payload) if field.name not in ("t_s", "valid")]
    message = ",".join(_text_of(getattr(payload, name)) for name in names)
    code = [CODES.get(module, module.upper()) for module in (sender, receiver)]
    return f"{code[0]}_{code[1]}_{round(payload.t_s * 1000)}_{message}"
