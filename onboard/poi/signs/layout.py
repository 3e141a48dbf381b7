"""Plate or poster, by how a sign is arranged: its lines of text in; where its number stands, and why it is none, out.

A plate holds one number in the site's form. Beside it, above or below may stand a name, a room type, or several small
lines; a pictogram; the number itself may stand on two lines. What holds more, or says what no plate does, is a poster,
a direction, a notice. Lines are judged in their own direction, by the height of their letters. Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from onboard.poi.signs.grouping import Row, rows_of
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.sign_words import is_name, is_notice, is_service
from onboard.poi.signs.text_line import TextLine

LARGER = 1.3  # a line whose letters are higher than the number's by that factor is what the sign is about
ALIKE = 0.78  # lines are alike when their letters differ by less than this share
SMALL = 0.6  # digits in letters lower than that share of the number's are notes, such as a telephone number
ALIKE_MAX = 2  # lines beside the number that are as high as it
ROWS_MAX = 8  # of other lines, in all
STACK_GAP = 1.4  # between the two lines of one number, in their letters' height
STACK_SHIFT = 1.0  # between their left ends, middles or right ends, the same
LEGIBLE = 0.5  # confidence from which other text counts
_JOINTS = ("-", ".", "/", "|", " ")  # what a line break stands for, in the order in which they are tried
NO_NUMBER = "no number"
_EDGES = " .,:;'\"`´·•*_|()[]"

Match = Callable[[str], RoomNumber | None]  # text -> the room number that it is as a whole


@dataclass(frozen=True, slots=True)
class Numbered:
    """A number on a sign: the lines that it stands on, and the text beside it on them."""

    number: RoomNumber
    lines: tuple[TextLine, ...]
    before: str = ""
    behind: str = ""

    @property
    def letter_px(self) -> float:
        return max(line.letter_px for line in self.lines)

    @property
    def confidence(self) -> float:
        if len(self.lines) == 1:
            return self.lines[0].confidence_of(self.number.shown)
        return min(line.confidence for line in self.lines)

    @property
    def damage(self) -> str:
        return next((line.damage for line in self.lines if line.damage), "")


@dataclass(frozen=True, slots=True)
class Arrangement:
    """What a sign holds: its number, if it is a plate; its other lines; `reason` when it is none."""

    numbered: Numbered | None
    others: tuple[TextLine, ...]
    reason: str = ""


def arranged(
    lines: Sequence[TextLine], match: Match, is_type: Callable[[str], bool], alone: bool = False
) -> Arrangement:
    """Finds the number on a sign. `is_type`: is a text a room type of the site? `alone`: only one that has its row."""
    rows = rows_of(lines)

    def known(text: str) -> bool:
        return is_type(text) or is_service(text)

    found = [one for row in rows if (one := _in_row(row, match, None if alone else known)) is not None]
    stacked = _stacked(rows, match)
    # A part of a number on two lines may be a number by itself
    if stacked is not None and len(found) <= 1:
        found = [stacked]
    elif len(found) > 1:
        highest = max(one.letter_px for one in found)
        found = [one for one in found if one.letter_px >= SMALL * highest]
    used = {id(line) for one in found for line in one.lines}
    beside = [[line for line in row if id(line) not in used and line.confidence > LEGIBLE] for row in rows]
    others = tuple(line for row in beside for line in row)
    if not found:
        return Arrangement(None, others, NO_NUMBER)
    if len({one.number for one in found}) > 1:
        return Arrangement(None, others, "several numbers")
    numbered = found[0]
    reason = _objection(numbered, others, known)
    # The words of a line may be read one by one
    if not reason and sum(bool(row) for row in beside) > ROWS_MAX:
        reason = "too many lines"
    return Arrangement(numbered, others, reason)


def _objection(numbered: Numbered, others: Sequence[TextLine], known: Callable[[str], bool]) -> str:
    """Why this is no plate though it holds a number; empty when it is one."""
    high = numbered.letter_px
    beside = [text for text in (numbered.before, numbered.behind) if text]
    if any(is_notice(text) for text in beside):
        return "a notice beside the number"
    alike = 0
    for line in others:
        text, share = line.text.strip(_EDGES), line.letter_px / high
        if share > SMALL and is_notice(line.text):
            return "a notice"
        if not text or known(text):
            continue
        if share > LARGER and len(text) > 2:
            return "a larger line"
        if share > SMALL and sum(c.isdigit() for c in text) >= 2:
            return "other digits"
        if share > ALIKE:
            alike += 1
            if not is_name(text) and len(text) > 2:
                return "prose"
    return "too many lines" if alike > ALIKE_MAX else ""


def _in_row(row: Row, match: Match, known: Callable[[str], bool] | None) -> Numbered | None:
    """The number on one row: as a whole, as some of its parts, or as words of one part with a name beside it.

    Without `known` there must be nothing beside it.
    """
    whole = (0, len(row))
    for first, last in [whole] if known is None else [whole, *combinations(range(len(row) + 1), 2)]:
        number = match(" ".join(line.text for line in row[first:last]))
        if number is not None:
            return Numbered(number, tuple(row[first:last]))
    if known is None:
        return None
    return next((found for line in row if (found := _with_name(line, match, known)) is not None), None)


def _with_name(line: TextLine, match: Match, known: Callable[[str], bool]) -> Numbered | None:
    """A number with a name behind it, or a room type before it, on one line: "214 Smith", "Lab 214"."""
    words = line.text.split()
    for count in range(len(words) - 1, 0, -1):
        behind = " ".join(words[count:])
        number = match(" ".join(words[:count]))
        if number is not None and (known(behind) or is_name(behind)):
            return Numbered(number, (line,), behind=behind)
        before = " ".join(words[:-count])
        number = match(" ".join(words[-count:]))
        if number is not None and known(before):
            return Numbered(number, (line,), before=before)
    return None


def _stacked(rows: Sequence[Row], match: Match) -> Numbered | None:
    """The number that two rows of letters of one height are together."""
    for upper, lower in pairwise(rows):
        if len(upper) != 1 or len(lower) != 1:
            continue
        a, b = upper[0], lower[0]
        high = max(a.letter_px, b.letter_px)
        near = b.middle[1] - a.middle[1] - high < STACK_GAP * high
        shift = min(abs(a.x_px - b.x_px), abs(a.middle[0] - b.middle[0]), abs(a.right_px - b.right_px))
        if min(a.letter_px, b.letter_px) < ALIKE * high or not near or shift > STACK_SHIFT * high:
            continue
        if not any(c.isdigit() for c in b.text):
            continue
        ends = a.text.strip(), b.text.strip()
        for joint in ("",) if ends[0][-1:] in _JOINTS or ends[1][:1] in _JOINTS else _JOINTS:
            number = match(joint.join(ends))
            if number is not None and number.repairs == 0:
                return Numbered(number, (a, b))
    return None
