"""Numbers that have the form of a room's and usually are none: years, times, ranges, emergency calls, voltages.

Each is only a suspicion: where the floor's other plates back it (`site_numbers.py`), it counts. A pattern that a site
wrote by itself is not suspected, except of showing no text at all.
"""

from __future__ import annotations

import re

_VOLTS = "12|24|48|110|115|120|127|220|230|240|380|400"
_UNITS = "VA|HZ|KHZ|MHZ|KW|KV|MA|MM|CM|KM|KG|ML|MG|MB|GB|EU|ST|ND|RD|TH|AM|PM"
_SUSPICIONS = (
    ("a year", re.compile("19[5-9][0-9]|20[0-3][0-9]")),
    ("an emergency call", re.compile("112")),
    ("a voltage", re.compile(f"(?:{_VOLTS})V")),
    ("a measure", re.compile(f"[0-9]+(?:{_UNITS})", re.IGNORECASE)),
    ("a time", re.compile(r"(?:0[89]|1[0-9]|2[0-3])\.(?:00|15|30|45)")),
    ("a date", re.compile(r"(?:0?[1-9]|[12][0-9]|3[01])([.-])(?:0?[1-9]|1[0-2])\1[23][0-9]")),
    ("opening hours", re.compile("24/7|(?:[5-9]|1[0-2])-(?:1[2-9]|2[0-4])")),
    ("a telephone number", re.compile("[0-9]{3}-[0-9]{4}")),
)
# Buttons, coins, lamps, holes
_CIRCLES = re.compile("[CDGOQ0]*[-./ ]?[CDGOQ]*00[CDGOQ0]*", re.IGNORECASE)
_RANGE = re.compile("([0-9]+)-([0-9]+)")
# On a line of its own, without a digit, beside the number that it explains
_LABEL = re.compile(
    r"(?:tel(?:efon|ephone)?|phone|fax|call|hotline|notruf|notfall|emergency|urgences?|sos|feuerwehr|fire brigade"
    r"|inv(?:entar|entory)?|asset|serial|s/n|id)\b[\s.:#-]*(?:no|nr|number|nummer|tag)?[\s.:#-]*",
    re.IGNORECASE,
)


def suspicion(number: str, own: bool = False) -> str:
    """What a room number may be instead, "a year" for example; empty when nothing is known.

    `own`: it is of a pattern that the site wrote by itself.
    """
    if _CIRCLES.fullmatch(number) is not None:
        return "a row of circles"
    if own:
        return ""
    span = _RANGE.fullmatch(number)
    if span is not None and len(span[1]) == len(span[2]) and span[1] < span[2]:
        return "a range of rooms"
    return next((what for what, pattern in _SUSPICIONS if pattern.fullmatch(number)), "")


def labels_another(line: str) -> bool:
    """Whether a line names what the number beside it is, and that is no room: "Tel.", "Inventory no."."""
    return _LABEL.fullmatch(line.strip()) is not None
