"""Payload <-> MessagePack, and the universal text form of the specification.

On the wire a message is `[CODEC_VERSION, sequence, boot_id, {field: value}]`. A field that is missing takes its
default, an unknown one is skipped: programs of neighbouring versions understand each other. Arrays travel as raw bytes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from enum import Enum
from typing import Any, Generic, TypeVar, get_origin, get_type_hints

import msgpack
import numpy as np
import numpy.typing as npt

from common.messages import NAME_OF_MODULE

CODEC_VERSION = 1
_ARRAY_EXT = 1
_MAX_ARRAY_BYTES = 64_000_000
_HEADER_BYTES = 32  # more than version, sequence and boot id can take
_SEQUENCE_MAX = 2**53
_UNDECODABLE = (
    *(ValueError, TypeError, AttributeError, KeyError, ArithmeticError, SyntaxError, MemoryError, RecursionError),
    msgpack.UnpackException,
)

P = TypeVar("P")


class DecodeError(ValueError):
    """These bytes are not a message of that type: one sentence says why."""


@dataclasses.dataclass(frozen=True, slots=True)
class Envelope(Generic[P]):
    """A payload with what the bus stamped on it."""

    payload: P
    sequence: int
    boot_id: int


def _pack_special(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return msgpack.ExtType(_ARRAY_EXT, msgpack.packb([array.dtype.str, list(array.shape), array.tobytes()]))
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a {type(value).__name__} cannot travel in a message")


def _unpack_special(code: int, data: bytes) -> Any:
    if code != _ARRAY_EXT:
        raise DecodeError(f"unknown MessagePack extension {code}")
    dtype, shape, raw = msgpack.unpackb(data)
    if np.dtype(dtype).hasobject:
        raise DecodeError("an array of objects")
    return np.frombuffer(raw, dtype=np.dtype(dtype)).reshape(shape)


Convert = Callable[[str, Any], Any]
_FIELDS: dict[type, dict[str, Convert]] = {}


def _fields(payload: type) -> dict[str, Convert]:
    """Name of every field -> what makes its value from MessagePack's."""
    if payload not in _FIELDS:
        hints = get_type_hints(payload)
        _FIELDS[payload] = {f.name: _converter(hints[f.name]) for f in dataclasses.fields(payload)}
    return _FIELDS[payload]


def encode(payload: Any, sequence: int, boot_id: int) -> bytes:
    """Bytes of a payload dataclass; raises TypeError for a value that cannot travel."""
    body = {}
    for name in _fields(type(payload)):
        value = getattr(payload, name)
        body[name] = value.value if isinstance(value, Enum) else value
    packed: bytes = msgpack.packb([CODEC_VERSION, sequence, boot_id, body], default=_pack_special)
    return packed


def _converter(hint: Any) -> Convert:
    """Looked up once per field: every message of every process passes here."""
    origin = get_origin(hint)
    if origin is tuple:
        return _to_tuple
    if origin is np.ndarray:
        return _to_array
    if isinstance(hint, type) and issubclass(hint, Enum):
        return lambda name, value: hint(value)
    allowed = (int, float) if hint is float else (hint,)

    def convert(name: str, value: Any) -> Any:
        if type(value) not in allowed:
            raise DecodeError(f"field '{name}' is a {type(value).__name__}, not a {hint.__name__}")
        return float(value) if hint is float else value

    return convert


def _to_tuple(name: str, value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise DecodeError(f"field '{name}' is no list")
    return tuple(value)


def _to_array(name: str, value: Any) -> npt.NDArray[Any]:
    if not isinstance(value, np.ndarray):
        raise DecodeError(f"field '{name}' is no array")
    return value


def decode(data: bytes, payload: type[P]) -> Envelope[P]:
    """The message in `data`; raises DecodeError with one sentence for anything that is none."""
    try:
        unpacked = msgpack.unpackb(data, ext_hook=_unpack_special, max_bin_len=_MAX_ARRAY_BYTES, strict_map_key=True)
        version, sequence, boot_id, body = unpacked
        if version != CODEC_VERSION:
            raise DecodeError(f"message of codec version {version}, this program speaks {CODEC_VERSION}")
        fields = _fields(payload)
        values = {name: fields[name](name, value) for name, value in body.items() if name in fields}
        return Envelope(payload(**values), int(sequence), int(boot_id))
    except DecodeError:
        raise
    except _UNDECODABLE as error:
        raise DecodeError(f"not a {payload.__name__} message: {error}") from error


def read_header(data: bytes) -> tuple[int, int]:
    """Sequence number and boot id without a look at the rest, whatever its version; raises DecodeError."""
    unpacker = msgpack.Unpacker()
    unpacker.feed(data[:_HEADER_BYTES])
    try:
        count = unpacker.read_array_header()
        _, sequence, boot_id = (unpacker.unpack() for _ in range(3))
    except _UNDECODABLE as error:
        raise DecodeError(f"no header of a message: {error}") from error
    in_range = type(sequence) is int and type(boot_id) is int and 0 < sequence < _SEQUENCE_MAX and 0 <= boot_id < 2**63
    if count != 4 or not in_range:
        raise DecodeError("no header of a message")
    return sequence, boot_id


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
    names = [n for n in _fields(type(payload)) if n not in ("t_s", "valid")]
    message = ",".join(_text_of(getattr(payload, n)) for n in names)
    code = [NAME_OF_MODULE.get(module, module.upper()) for module in (sender, receiver)]
    return f"{code[0]}_{code[1]}_{round(payload.t_s * 1000)}_{message}"
