"""Plate or poster: the lines of text of one sign in; its room number and room type out.

A number plate holds one number in the site's format, perhaps a room type, and nothing else of that size. Posters,
directions to ranges of rooms, years and telephone numbers hold more.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from common.config import PoiSection
from onboard.poi.signs.false_numbers import labels_another
from onboard.poi.signs.number_forms import NumberForms, RoomNumber, site_forms
from onboard.poi.signs.text_line import TextLine

CONFIDENT = 0.90  # confidence from which a number counts
LEGIBLE = 0.5  # confidence from which other text counts
NUMBER_HEIGHT_M = (0.018, 0.13)  # of the letters as measured, up to twice their own
OPEN_GAP = 1.0  # to the border of the picture, in heights: enough to see that there is no neighbour
SECONDARY = 0.8  # other lines of a plate are lower than this share of its number
TYPE_LIKENESS = 0.75  # ratio of difflib between a line and a room type


class Verdict(Enum):
    """The class of a sign, as `SignRules.judge` decides it."""

    PLATE = "plate"
    DOUBTFUL = "doubtful"  # a plate whose number counts only where other plates back it, see `site_numbers.py`
    UNCLEAR = "unclear"  # a plate by its looks, but not legible; worth another photo
    OTHER = "other"  # a poster, a direction, a notice


@dataclass(frozen=True, slots=True)
class SignReading:
    """One sign; `box` x, y, width, height in pixels of the picture that was read. `reason`: why it is no PLATE."""

    verdict: Verdict
    number: RoomNumber | None
    room_type: str
    confidence: float
    box: tuple[float, float, float, float]
    lines: tuple[str, ...]
    reason: str = ""


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
        found = [(line, number) for line in lines if (number := self.forms.match(line.text)) is not None]
        numbers = self._candidates(found)
        types = [(line, kind) for line in lines if (kind := self.room_type(line.text))]
        named = [line for line, _ in numbers] + [line for line, _ in types]
        others = [line for line in lines if line not in named and line.confidence > LEGIBLE]
        x0, y0 = min(line.x_px for line in lines), min(line.y_px for line in lines)
        x1, y1 = max(line.right_px for line in lines), max(line.bottom_px for line in lines)
        reading = SignReading(
            Verdict.OTHER, None, "", 0.0, (x0, y0, x1 - x0, y1 - y0), tuple(line.text for line in lines)
        )
        if len(numbers) != 1:
            vague = not found and len(lines) <= 2 and not _is_prose(lines) and bool(types or _digits(lines))
            reason = (
                f"{len(numbers)} numbers" if numbers else f"may be {found[0][1].suspicion}" if found else "no number"
            )
            return replace(reading, verdict=Verdict.UNCLEAR if vague else Verdict.OTHER, reason=reason)
        line, number = numbers[0]
        if m_per_px is not None and not NUMBER_HEIGHT_M[0] <= line.letter_px * m_per_px <= NUMBER_HEIGHT_M[1]:
            return replace(reading, reason="letters not of a plate's size")
        if any(other.height_px > SECONDARY * line.height_px for other in others):
            return replace(reading, reason="other text as large as the number")
        if any(labels_another(other.text) for other in others):
            return replace(reading, reason="a label names another kind of number")
        room_type = types[0][1] if types else self.room_type(number.words)
        reading = replace(reading, number=number, room_type=room_type, confidence=line.confidence)
        # A neighbouring line may hide behind the picture's border
        reach_px = OPEN_GAP * line.letter_px
        if image_height_px is not None and (y0 < reach_px or y1 > image_height_px - reach_px):
            return replace(reading, verdict=Verdict.UNCLEAR, reason="cut off by the border")
        if line.confidence < CONFIDENT:
            return replace(reading, verdict=Verdict.UNCLEAR, reason="not legible")
        return replace(reading, verdict=Verdict.PLATE if self.forms.counts(number) else Verdict.DOUBTFUL)

    def _candidates(self, found: list[tuple[TextLine, RoomNumber]]) -> list[tuple[TextLine, RoomNumber]]:
        """Those that count by themselves; where there are none, those that other plates may back."""
        by_itself = [pair for pair in found if self.forms.counts(pair[1])]
        return by_itself or [pair for pair in found if self.forms.may_count(pair[1])]

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


def _digits(lines: Sequence[TextLine]) -> bool:
    return any(c.isdigit() for line in lines for c in line.text)
