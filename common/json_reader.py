"""Reads values out of a JSON document, and raises an error of one sentence for a value that is not valid.

Serves what people write by hand (floors, events, the pose of a photo) and what a run folder holds.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from common.geometry import Points
from common.plain_text import plain
from common.text_file import read_text

Colour = tuple[int, int, int]
TEXT_MAX = 1000  # characters
_LARGEST = 1e6


def load_json(path: Path, source: str, error_type: type[Exception]) -> Any:
    """The document in a file; raises `error_type` when it cannot be read or is no JSON."""
    text = read_text(path, source, error_type, "JSON")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise error_type(f"{source} is not JSON: {error}") from error


def is_number(value: Any) -> bool:
    """A JSON number that a length or an angle can be (NaN and the infinities are none)."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST


class Node:
    """One object of a JSON document that knows its file and its key, so that every complaint can name them.

    `source` describes the file to a person; `error_type` is what every method raises when the document is wrong.
    """

    def __init__(self, content: Any, source: str, error_type: type[Exception], key: str = "") -> None:
        self._source, self._key, self._error_type = source, key, error_type
        if not isinstance(content, dict):
            raise error_type(f"{source}: {f'key {key!r}' if key else 'the document'} must be an object")
        self._content: dict[str, Any] = content

    def error(self, key: str, complaint: str) -> Exception:
        """What to raise about a key of this object."""
        return self._error_type(f"{self._source}: key '{self._path(key)}' {complaint}")

    def _path(self, key: str) -> str:
        return f"{self._key}.{key}" if self._key and key else self._key or key

    def value(self, key: str) -> Any:
        if key not in self._content:
            raise self.error(key, "is missing")
        return self._content[key]

    def child(self, key: str) -> Node:
        return Node(self.value(key), self._source, self._error_type, self._path(key))

    def items(self, key: str) -> list[Any]:
        value = self.value(key)
        if not isinstance(value, list):
            raise self.error(key, "must be a list")
        return value

    def points(self, key: str, value: Any, at_least: int) -> Points:
        """(N, 2) of a value that stands at a key."""
        if not isinstance(value, list) or len(value) < at_least:
            raise self.error(key, f"must have at least {at_least} point{'s' if at_least > 1 else ''}")
        for point in value:
            if not isinstance(point, list) or len(point) != 2 or not all(map(is_number, point)):
                raise self.error(key, "must be a list of points [x, y]")
        return np.array(value, dtype=np.float64)

    def children(self, key: str) -> list[Node]:
        return [
            Node(item, self._source, self._error_type, f"{self._path(key)}[{i}]")
            for i, item in enumerate(self.items(key))
        ]

    def has(self, key: str) -> bool:
        """Is there a value? null is none."""
        return self._content.get(key) is not None

    def optional_children(self, key: str) -> list[Node]:
        """Like `children`, none where the key is missing."""
        return self.children(key) if self.has(key) else []

    def number(self, key: str) -> float:
        value = self.value(key)
        if not is_number(value):
            raise self.error(key, f"must be a number between {-_LARGEST:g} and {_LARGEST:g}")
        return float(value)

    def length(self, key: str, above: float = 0.0, at_most: float = _LARGEST) -> float:
        value = self.number(key)
        if not above < value <= at_most:
            raise self.error(key, f"must be greater than {above:g} and at most {at_most:g}")
        return value

    def whole(self, key: str) -> int:
        value = self.value(key)
        if not isinstance(value, int) or not is_number(value):
            raise self.error(key, "must be a whole number")
        return value

    def text(self, key: str) -> str:
        """As one line that every picture and terminal can show."""
        value = self.value(key)
        if not isinstance(value, str):
            raise self.error(key, "must be a text")
        return plain(value, TEXT_MAX)

    def flag(self, key: str) -> bool:
        value = self.value(key)
        if not isinstance(value, bool):
            raise self.error(key, "must be true or false")
        return value

    def colour(self, key: str) -> Colour:
        value = self.value(key)
        if not isinstance(value, list) or len(value) != 3 or not all(is_number(v) and 0 <= v <= 255 for v in value):
            raise self.error(key, "must be three numbers from 0 to 255")
        return int(value[0]), int(value[1]), int(value[2])
