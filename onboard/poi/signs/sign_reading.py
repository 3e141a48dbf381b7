"""Plate or poster: the lines of text of one sign in; its room number and room type out.

`layout.py` finds where the number stands and whether the sign is arranged as plates are; here its size, its damage and
the site's forms decide whether it counts.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from common.config import PoiSection
from onboard.poi.signs.false_numbers import labels_another
from onboard.poi.signs.grouping import rows_of
from onboard.poi.signs.layout import NO_NUMBER, arranged
from onboard.poi.signs.number_forms import NumberForms, RoomNumber, site_forms
from onboard.poi.signs.sign_words import is_notice, is_service
from onboard.poi.signs.text_line import TextLine, around

CONFIDENT = 0.80  # confidence of the least certain letter or digit, from which a number counts
CONFIDENT_REPAIRED = 0.99  # the same for a number in which letters were exchanged: half an M is an I, too
NUMBER_HEIGHT_M = (0.018, 0.13)  # of the letters as measured, up to twice their own
OPEN_GAP = 1.0  # to the border of the picture, in heights: enough to see that there is no neighbour
TYPE_LIKENESS = 0.75  # ratio of difflib between a line and a room type


class Verdict(Enum):
    """The class of a sign, as `SignRules.judge` decides it."""

    PLATE = "plate"
    DOUBTFUL = "doubtful"  # a plate whose number counts only where other plates back it, see `site_numbers.py`
    UNCLEAR = "unclear"  # a plate by its looks, but not legible; worth another photo
    NAMED = "named"  # a plate that names a room and has no number
    OTHER = "other"  # a poster, a direction, a notice


@dataclass(frozen=True, slots=True)
class SignReading:
    """One sign; `box` x, y, width, height in pixels of the picture that was read. `reason`: why it is no PLATE.

    `damaged`: a part of the number's line may be hidden.
    """

    verdict: Verdict
    number: RoomNumber | None
    room_type: str
    confidence: float
    box: tuple[float, float, float, float]
    lines: tuple[str, ...]
    reason: str = ""
    damaged: bool = False


@dataclass(frozen=True, slots=True)
class SignRules:
    """Plate or poster, by the site's forms of room numbers and its list of room types."""

    forms: NumberForms
    room_types: tuple[str, ...]

    def judge(
        self, lines: Sequence[TextLine], m_per_px: float | None = None, image_height_px: float | None = None
    ) -> SignReading:
        """One sign, from its lines; `m_per_px` is the scale on the wall, where it is known.

        `image_height_px` of a picture whose upper and lower border may hide more of the sign; None where it is whole.
        """
        arrangement = arranged(lines, self._that_counts, self._is_type)
        if arrangement.numbered is None and arrangement.reason == NO_NUMBER:
            arrangement = arranged(lines, self._that_may_count, self._is_type, alone=True)
        numbered = arrangement.numbered
        reading = SignReading(
            Verdict.OTHER, None, "", 0.0, around(lines), tuple(line.text for line in lines), arrangement.reason
        )
        if numbered is None:
            room_type, instead = self._room_type_of(lines), self._suspicion(lines)
            if instead:
                return replace(reading, room_type=room_type, reason=f"may be {instead}")
            return replace(reading, verdict=self._without_number(lines), room_type=room_type)
        if arrangement.reason:
            return reading
        if m_per_px is not None and not NUMBER_HEIGHT_M[0] <= numbered.letter_px * m_per_px <= NUMBER_HEIGHT_M[1]:
            return replace(reading, reason="letters not of a plate's size")
        if any(labels_another(line.text) for line in arrangement.others):
            return replace(reading, reason="a label names another kind of number")
        number = numbered.number
        beside = [numbered.before, numbered.behind, number.words]
        room_type = self._room_type_of(arrangement.others) or next(filter(None, map(self.room_type, beside)), "")
        reading = replace(reading, number=number, room_type=room_type, confidence=numbered.confidence)
        # A neighbouring line may hide behind the picture's border
        reach_px = OPEN_GAP * numbered.letter_px
        _, y, _, height = reading.box
        if image_height_px is not None and (y < reach_px or y + height > image_height_px - reach_px):
            return replace(reading, verdict=Verdict.UNCLEAR, reason="cut off by the border")
        if numbered.damage or numbered.confidence < (CONFIDENT_REPAIRED if number.repairs else CONFIDENT):
            reason, damaged = numbered.damage or "not legible", bool(numbered.damage)
            return replace(reading, verdict=Verdict.UNCLEAR, reason=reason, damaged=damaged)
        return replace(reading, verdict=Verdict.PLATE if self.forms.counts(number) else Verdict.DOUBTFUL)

    def _that_counts(self, text: str) -> RoomNumber | None:
        number = self.forms.match(text)
        return number if number is not None and self.forms.counts(number) else None

    def _that_may_count(self, text: str) -> RoomNumber | None:
        """Numbers that other plates may back."""
        number = self.forms.match(text)
        return number if number is not None and self.forms.may_count(number) else None

    def _suspicion(self, lines: Sequence[TextLine]) -> str:
        """What a line is that has the form of a number at other sites; another photo would show the same."""
        numbers = (self.forms.match(line.text) for line in lines)
        return next((n.suspicion for n in numbers if n is not None and not self.forms.may_count(n)), "")

    def _without_number(self, lines: Sequence[TextLine]) -> Verdict:
        named = [line for line in lines if self._is_type(line.text) or is_service(line.text)]
        if named and len(lines) <= 2 and all(line in named or not _has_digit(line) for line in lines):
            return Verdict.NAMED
        if any(is_notice(line.text) for line in lines):
            return Verdict.OTHER
        vague = len(lines) <= 2 and not _is_prose(lines) and any(_has_digit(line) for line in lines)
        return Verdict.UNCLEAR if vague else Verdict.OTHER

    def _is_type(self, text: str) -> bool:
        return bool(self.room_type(text))

    def _room_type_of(self, lines: Sequence[TextLine]) -> str:
        """The site's room type on one of the lines, or the word for a room that needs no number, as it stands there.

        Slanted words come in pieces: "Lab" beside "oratory".
        """
        rows = ["".join(line.text for line in row) for row in rows_of(lines)]
        kinds = (self.room_type(text) for text in (*rows, *(line.text for line in lines)))
        services = (line.text for line in lines if is_service(line.text))
        return next(filter(None, kinds), "") or next(services, "")

    def room_type(self, text: str) -> str:
        """The nearest of the site's room types, empty when none is near."""
        plain = " ".join(text.lower().split())
        if len(plain) < 2 or any(c.isdigit() for c in plain):
            return ""
        known = {kind.lower(): kind for kind in self.room_types}
        tight = {kind.replace(" ", ""): kind for kind in known}
        match = difflib.get_close_matches(plain.replace(" ", ""), tight, n=1, cutoff=TYPE_LIKENESS)
        return known[tight[match[0]]] if match else ""


def sign_rules(section: PoiSection) -> SignRules:
    """The site's rules as robot.toml gives them."""
    return SignRules(site_forms(section), section.room_types)


def _is_prose(lines: Sequence[TextLine]) -> bool:
    """More letters than a suffix or a cut room type has."""
    return any(sum(c.isalpha() for c in line.text) > 3 and line.confidence > 0.9 for line in lines)


def _has_digit(line: TextLine) -> bool:
    return any(c.isdigit() for c in line.text)
