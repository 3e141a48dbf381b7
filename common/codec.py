"""Payload <-> MessagePack, and the universal text form of the specification.

On the wire a message is `[CODEC_VERSION, sequence, boot_id, {field: value}]`. A field that is missing takes its
default, an unknown one is skipped: programs of neighbouring versions understand each other. Arrays travel as raw bytes.
"""

from __future__ import annotations

import dataclasses
import math
from enum import Enum
from typing import Any, Generic, TypeVar, get_origin, get_type_hints

import msgpack
import numpy as np

from common.messages import NAME_OF_MODULE

CODEC_VERSION = 1
_ARRAY_EXT = 1
_MAX_ARRAY_BYTES = 64_000_000
_UNDECODABLE = (ValueError, TypeError, AttributeError, KeyError, ArithmeticError, SyntaxError, msgpack.UnpackException)

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


_FIELDS: dict[type, dict[str, Any]] = {}


def _fields(payload: type) -> dict[str, Any]:
    if payload not in _FIELDS:
        hints = get_type_hints(payload)
        _FIELDS[payload] = {f.name: hints[f.name] for f in dataclasses.fields(payload)}
    return _FIELDS[payload]


def encode(payload: Any, sequence: int, boot_id: int) -> bytes:
    """Bytes of a payload dataclass; raises TypeError for a value that cannot travel."""
    body = {}
    for name in _fields(type(payload)):
        value = getattr(payload, name)
        body[name] = value.value if isinstance(value, Enum) else value
    packed: bytes = msgpack.packb([CODEC_VERSION, sequence, boot_id, body], default=_pack_special)
    return packed


def _convert(name: str, value: Any, hint: Any) -> Any:
    origin = get_origin(hint)
    if origin is tuple:
        if not isinstance(value, list):
            raise DecodeError(f"field '{name}' is no list")
        return tuple(value)
    if origin is np.ndarray:
        if not isinstance(value, np.ndarray):
            raise DecodeError(f"field '{name}' is no array")
        return value
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint(value)
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise DecodeError(f"field '{name}' is a {type(value).__name__}, not a {hint.__name__}")
    return value


def decode(data: bytes, payload: type[P]) -> Envelope[P]:
    """The message in `data`; raises DecodeError with one sentence for anything that is none."""
    try:
        unpacked = msgpack.unpackb(data, ext_hook=_unpack_special, max_bin_len=_MAX_ARRAY_BYTES, strict_map_key=True)
        version, sequence, boot_id, body = unpacked
        if version != CODEC_VERSION:
            raise DecodeError(f"message of codec version {version}, this program speaks {CODEC_VERSION}")
        hints = _fields(payload)
        values = {name: _convert(name, value, hints[name]) for name, value in body.items() if name in hints}
        return Envelope(payload(**values), int(sequence), int(boot_id))
    except DecodeError:
        raise
    except _UNDECODABLE as error:
        raise DecodeError(f"not a {payload.__name__} message: {error}") from error


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
