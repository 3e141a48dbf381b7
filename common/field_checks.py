"""From the type of a field (`fields`) to what takes its value in or refuses it; made once per payload class. Pure.

The same checks serve both ways: a value that came over the wire, and one that is about to be sent, which may also be an
enum's member or one of NumPy's numbers.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from enum import Enum
from math import inf
from numbers import Integral, Real
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np

from common.fields import Formerly, Shape, UpTo, Within
from common.plain_text import plain

Take = Callable[[Any], Any]  # a value -> the value to go on with; raises UnfitValue
Notes = dict[type, Any]  # what an annotation holds beside the type, by its class

_KINDS: dict[type, Any] = {bool: (bool, np.bool_), int: Integral, float: Real}


class UnfitValue(ValueError):
    """A field must not hold that value; the message is one sentence that names both."""


class Field(NamedTuple):
    """What is of the type `right` and, where there are bounds, within them, is taken as it is.

    Anything else goes through `take`.
    """

    take: Take
    right: type | None = None
    within: Within | None = None
    former: str = ""  # its name in older recordings
    like: str = ""  # the letter by which its length is that of other fields


def field_of(name: str, hint: Any) -> Field:
    """Of its name and an annotation as the message table has them; raises TypeError for one without bounds."""
    notes: Notes = {}
    if get_origin(hint) is Annotated:
        hint, *annotations = get_args(hint)
        notes = {type(note): note for note in annotations}
    kind = get_origin(hint) or hint
    make = _member if issubclass(kind, Enum) else _MAKERS[kind]
    try:
        field = make(name, hint, notes)
    except KeyError as error:
        raise TypeError(f"field '{name}' has no bounds: {hint} needs {error}") from error
    return field._replace(former=notes[Formerly].name) if Formerly in notes else field


def unfit(name: str, value: Any) -> UnfitValue:
    return UnfitValue(f"field '{name}' must not be {reprlib.repr(value)}")


def check_lengths(**alike: Any) -> None:
    """Fields that must be of one length, by their names; raises UnfitValue where they are not."""
    lengths = {name: len(value) for name, value in alike.items()}
    if len(set(lengths.values())) > 1:
        raise UnfitValue(f"fields of different lengths: {lengths}")


def _flag(name: str, hint: Any, notes: Notes) -> Field:
    def take(value: Any) -> Any:
        if not isinstance(value, (bool, np.bool_)):
            raise unfit(name, value)
        return bool(value)

    return Field(take, bool)


def _number(name: str, hint: Any, notes: Notes) -> Field:
    within: Within = notes[Within]
    kinds: Any = Integral if hint is int else Real

    def take(value: Any) -> Any:
        fits = isinstance(value, kinds) and not isinstance(value, bool)
        if not fits or not (within.low <= value <= within.high or (within.or_nan and value != value)):
            raise unfit(name, value)
        return hint(value)

    return Field(take, hint, within)


def _member(name: str, hint: Any, notes: Notes) -> Field:
    members = {member.value: member for member in hint}
    (right,) = {type(value) for value in members}

    def take(value: Any) -> Any:
        if type(value) is right and value in members:
            return members[value]
        if isinstance(value, hint):
            return value
        raise unfit(name, value)

    return Field(take)


def _text(name: str, hint: Any, notes: Notes) -> Field:
    length_max = notes[UpTo].count

    def take(value: Any) -> Any:
        if not isinstance(value, str):
            raise unfit(name, value)
        return value if len(value) <= length_max and value.isprintable() else plain(value, length_max)

    return Field(take)


def _bytes(name: str, hint: Any, notes: Notes) -> Field:
    length_max = notes[UpTo].count

    def take(value: Any) -> Any:
        if type(value) is not bytes:
            raise unfit(name, value)
        if len(value) > length_max:
            raise UnfitValue(f"field '{name}' has {len(value)} bytes, more than {length_max}")
        return value

    return Field(take)


def _tuple(name: str, hint: Any, notes: Notes) -> Field:
    element = field_of(name, get_args(hint)[0])
    right: Any = element.right
    take_element, within = element.take, element.within or Within(-inf, inf)
    low, high, or_nan = within.low, within.high, within.or_nan
    least, most, like = _lengths(notes)

    def take(value: Any) -> Any:
        if type(value) is not tuple:
            raise unfit(name, value)
        if not least <= len(value) <= most:
            raise UnfitValue(f"field '{name}' has {len(value)} elements, not {least} to {most}")
        return tuple(
            [v if type(v) is right and (low <= v <= high or (v != v and or_nan)) else take_element(v) for v in value]
        )

    return Field(take, like=like)


def _array(name: str, hint: Any, notes: Notes) -> Field:
    dtype = np.dtype(get_args(get_args(hint)[1])[0])
    within, sizes = notes[Within], notes[Shape].sizes
    least, most, like = _lengths(notes)

    def take(value: Any) -> Any:
        if type(value) is not np.ndarray:
            raise unfit(name, value)
        right = value.dtype is dtype or np.can_cast(value.dtype, dtype, "same_kind")
        if not right or value.ndim != len(sizes) or value.shape[1:] != sizes[1:]:
            raise UnfitValue(f"field '{name}' is {value.dtype} {value.shape}, not {dtype} {sizes}")
        if not least <= len(value) <= most:
            raise UnfitValue(f"field '{name}' has {len(value)} rows, not {least} to {most}")
        # NaN is neither
        if value.size and not (within.low <= value.min() and value.max() <= within.high):
            raise UnfitValue(f"field '{name}' holds a number outside of {within.low:g} to {within.high:g}")
        return value.astype(dtype, copy=False)

    return Field(take, like=like)


def _lengths(notes: Notes) -> tuple[int, int, str]:
    """The least and the greatest length, and the letter that stands for it."""
    first = notes[Shape].sizes[0]
    return (0, notes[UpTo].count, first) if isinstance(first, str) else (first, first, "")


_MAKERS: dict[type, Callable[[str, Any, Notes], Field]] = {
    bool: _flag,
    int: _number,
    float: _number,
    str: _text,
    bytes: _bytes,
    tuple: _tuple,
    np.ndarray: _array,
}
