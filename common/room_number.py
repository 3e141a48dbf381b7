"""A room's number: as the plate shows it, and as it is compared.

The shown form is the plate's own, separators kept: `16-186`, `2.01`, `S1|07`. Numbers are equal when their keys are;
rooms that differ only in separators (`1.05`, `10.5`, `105`) have different ones. A key is its own key.
"""

from __future__ import annotations

import re

# One sign for what readers, engines and keyboards write in several ways; only separators, never a letter or digit
_DASHES, _POINTS, _BARS, _SLASHES = "‐‑‒–—―−﹣-", "·•∙⋅・․.", "¦│∣❘|", "⁄∕/"
_FOLDED = str.maketrans(
    dict.fromkeys(_DASHES, "-")
    | dict.fromkeys(_POINTS, ".")
    | dict.fromkeys(_BARS, "|")
    | dict.fromkeys(_SLASHES, "/")
    | {chr(0xFEE0 + code): chr(code) for code in range(0x21, 0x7F)}  # full width
)
DASHES_OF_OTHERS = _DASHES.replace("-", "")
_SPACE_BESIDE_NO_DIGIT = re.compile(r"(?<![0-9]) | (?![0-9])")


def plain(text: str) -> str:
    """A line with one sign for each separator, full-width letters as usual ones, and single spaces."""
    # Twice, since a full-width bar or dash becomes one of those that are folded
    return " ".join(text.translate(_FOLDED).translate(_FOLDED).split())


def tight(text: str) -> str:
    """Without spaces, but those between two digits."""
    return _SPACE_BESIDE_NO_DIGIT.sub("", text)


def key_of(number: str) -> str:
    """The key of a number in its shown form, or of a key: capitals, separators, a space only between two digits."""
    return tight(plain(number).upper())
