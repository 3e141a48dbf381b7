"""Payload <-> MessagePack, and the universal text form of the specification.

On the wire a message is `[CODEC_VERSION, sequence, boot_id, {field: value}]`. A field that is missing takes its
default, an unknown one is skipped: programs of neighbouring versions understand each other. Arrays travel as raw bytes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from enum import Enum
from operator import attrgetter
from typing import Annotated, Any, Generic, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import msgpack
import numpy as np

from common.messages import NAME_OF_MODULE

CODEC_VERSION = 1
_ARRAY_EXT = 1
_HEADER_BYTES = 32  # more than version, sequence and boot id can take
_SEQUENCE_MAX = 2**53
_UNDECODABLE = (
    *(ValueError, TypeError, AttributeError, KeyError, ArithmeticError, SyntaxError, MemoryError, RecursionError),
    msgpack.UnpackException,
)

P = TypeVar("P")


class DecodeError(ValueError):
    """These bytes are not a message of that type: one sentence says why."""


class Envelope(NamedTuple, Generic[P]):
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
    if isinstance(value, Enum):
        return value.value
    raise TypeError(f"a {type(value).__name__} cannot travel in a message")


def _unpack_special(code: int, data: bytes) -> Any:
    if code != _ARRAY_EXT:
        raise DecodeError(f"unknown MessagePack extension {code}")
    dtype, shape, raw = msgpack.unpackb(data)
    if np.dtype(dtype).hasobject:
        raise DecodeError("an array of objects")
    return np.frombuffer(raw, dtype=np.dtype(dtype)).reshape(shape)


Convert = Callable[[str, Any], Any]
Shape = tuple[str | int, ...]


class _Form(NamedTuple):
    """How a payload class travels; made once, for every message of every process passes here."""

    names: tuple[str, ...]
    values: Callable[[Any], tuple[Any, ...]]  # of all fields, in this order
    fields: dict[str, tuple[type | None, Convert]]  # the type that is taken as it is, and what converts or refuses
    arrays: dict[str, tuple[np.dtype[Any], Shape]]


_FORMS: dict[type, _Form] = {}


def _form(payload: type) -> _Form:
    if payload not in _FORMS:
        hints = get_type_hints(payload)
        names = tuple(field.name for field in dataclasses.fields(payload))
        annotated = get_type_hints(payload, include_extras=True)
        arrays = {name: _array(annotated[name]) for name in names if get_origin(annotated[name]) is Annotated}
        _FORMS[payload] = _Form(names, attrgetter(*names), {name: _reading(hints[name]) for name in names}, arrays)
    return _FORMS[payload]


def encode(payload: Any, sequence: int, boot_id: int) -> bytes:
    """Bytes of a payload dataclass; raises TypeError for a value that cannot travel."""
    form = _form(type(payload))
    body = dict(zip(form.names, form.values(payload), strict=True))
    packed: bytes = msgpack.packb((CODEC_VERSION, sequence, boot_id, body), default=_pack_special)
    return packed


def _reading(hint: Any) -> tuple[type | None, Convert]:
    origin = get_origin(hint)
    if origin is tuple:
        return None, _to_tuple
    if origin is np.ndarray:
        return np.ndarray, _refuse
    if issubclass(hint, Enum):
        return None, lambda _, value: hint(value)
    return hint, _to_float if hint is float else _refuse


def _array(hint: Any) -> tuple[np.dtype[Any], Shape]:
    """What `Annotated[NDArray[number], shape]` says."""
    array, shape = get_args(hint)
    (number,) = get_args(get_args(array)[1])
    return np.dtype(number), shape


def _check_arrays(arrays: dict[str, tuple[np.dtype[Any], Shape]], values: dict[str, Any]) -> None:
    sizes: dict[str | int, int] = {}
    for name, (dtype, shape) in arrays.items():
        if name not in values:
            continue
        array = values[name]
        fits = array.ndim == len(shape) and np.can_cast(array.dtype, dtype, "same_kind")
        for dimension, size in zip(shape, array.shape, strict=False):
            expected = sizes.setdefault(dimension, size) if isinstance(dimension, str) else dimension
            fits = fits and size == expected
        if not fits:
            raise DecodeError(f"field '{name}' is {array.dtype} {array.shape}, not {dtype} {shape}")


def _refuse(name: str, value: Any) -> Any:
    raise DecodeError(f"field '{name}' must not be a {type(value).__name__}")


def _to_float(name: str, value: Any) -> float:
    return float(value) if type(value) is int else _refuse(name, value)


def _to_tuple(name: str, value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise DecodeError(f"field '{name}' is no list")
    return tuple(value)


def decode(data: bytes, payload: type[P]) -> Envelope[P]:
    """The message in `data`; raises DecodeError with one sentence for anything that is none."""
    try:
        version, sequence, boot_id, body = msgpack.unpackb(data, ext_hook=_unpack_special)
        if version != CODEC_VERSION:
            raise DecodeError(f"message of codec version {version}, this program speaks {CODEC_VERSION}")
        form = _form(payload)
        fields, values = form.fields, {}
        for name, value in body.items():
            if name in fields:
                right, convert = fields[name]
                values[name] = value if type(value) is right else convert(name, value)
        if form.arrays:
            _check_arrays(form.arrays, values)
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
    names = [n for n in _form(type(payload)).names if n not in ("t_s", "valid")]
    message = ",".join(_text_of(getattr(payload, n)) for n in names)
    code = [NAME_OF_MODULE.get(module, module.upper()) for module in (sender, receiver)]
    return f"{code[0]}_{code[1]}_{round(payload.t_s * 1000)}_{message}"
