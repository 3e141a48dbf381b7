"""What a value of `robot.toml` must be besides its type: annotations of the fields in `config`.

A rule returns the end of a sentence that begins with the key ("must be between 0 and 1"), or an empty text.
"""

from __future__ import annotations

import re
import reprlib
import warnings
from dataclasses import dataclass
from typing import Any, Protocol

from common.room_number import DASHES_OF_OTHERS


class Rule(Protocol):
    def complaint(self, value: Any) -> str:
        """What is wrong with a value of the right type; empty when nothing is."""


@dataclass(frozen=True, slots=True)
class Between:
    """A number within both limits, which neither NaN nor infinity is."""

    low: float
    high: float

    def complaint(self, value: float) -> str:
        return "" if self.low <= value <= self.high else f"must be between {self.low:.10g} and {self.high:.10g}"


@dataclass(frozen=True, slots=True)
class Form:
    """A text that a regular expression describes as a whole; `what` ends the sentence."""

    pattern: str
    what: str

    def complaint(self, value: str) -> str:
        fits = re.fullmatch(self.pattern, value) is not None
        return "" if fits else f"{self.what}, not {reprlib.repr(value)}"


@dataclass(frozen=True, slots=True)
class Count:
    """A list of so many values."""

    count: int
    what: str

    def complaint(self, value: tuple[Any, ...]) -> str:
        return "" if len(value) == self.count else f"must hold {self.count} {self.what}, not {len(value)}"


@dataclass(frozen=True, slots=True)
class Names:
    """A list of what is among these names."""

    known: tuple[str, ...]
    what: str

    def complaint(self, value: tuple[str, ...]) -> str:
        unknown = next((name for name in value if name not in self.known), None)
        return "" if unknown is None else f"names {reprlib.repr(unknown)}; {self.what} are {', '.join(self.known)}"


@dataclass(frozen=True, slots=True)
class Pattern:
    """A regular expression that Python takes without a doubt, of at most so many characters."""

    longest: int

    def complaint(self, value: str) -> str:
        if len(value) > self.longest:
            return f"must be a regular expression of at most {self.longest} characters"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                re.compile(value)
        except (re.error, OverflowError, RecursionError, Warning) as error:
            return f"is no regular expression: {error}"
        return ""


@dataclass(frozen=True, slots=True)
class OnPlate:
    """A regular expression of what stands on a plate, in the signs that its text is compared in; or an empty text."""

    def complaint(self, value: str) -> str:
        dash = next((sign for sign in value if sign in DASHES_OF_OTHERS), None)
        if dash is not None:
            return f'holds the dash "{dash}", which is read as "-"; write "-"'
        if "," in re.sub(r"\{[0-9]*,[0-9]*\}", "", value):
            return 'holds a comma, which goto takes for X,Y; a comma on a plate is read as "."'
        if value and re.fullmatch(value, "") is not None:
            return "fits an empty text, so it describes no number"
        return ""
