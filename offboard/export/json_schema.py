"""Messages as JSON, with the JSON schema of their dataclass: what a log player needs to show them. Pure."""

from __future__ import annotations

import dataclasses
import json
from enum import Enum
from math import isfinite
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

_TYPES: dict[Any, dict[str, Any]] = {
    float: {"type": ["number", "null"]},
    int: {"type": "integer"},
    bool: {"type": "boolean"},
}


def schema_of(payload: type) -> bytes:
    """Of a message's dataclass; what is no number there (NaN: nothing answered) is null."""
    hints = get_type_hints(payload)
    properties = {field.name: _schema(hints[field.name]) for field in dataclasses.fields(payload)}
    return json.dumps({"title": payload.__name__, "type": "object", "properties": properties}).encode()


def _schema(hint: Any) -> dict[str, Any]:
    if hint in _TYPES:
        return _TYPES[hint]
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"type": "string", "enum": [member.name for member in hint]}
    if get_origin(hint) is tuple:
        return {"type": "array", "items": _schema(get_args(hint)[0])}
    if hint in (str, bytes):
        return {"type": "string"}
    return {"type": "array"}


def as_json(payload: Any) -> bytes:
    content = {field.name: _value(getattr(payload, field.name)) for field in dataclasses.fields(payload)}
    return json.dumps(content, allow_nan=False, ensure_ascii=False).encode()


def _value(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, np.ndarray):
        return _value(value.tolist())
    if isinstance(value, list | tuple):
        return [_value(one) for one in value]
    return value
