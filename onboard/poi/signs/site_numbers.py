"""Which room numbers count at this site, by what its plates show: numbers that were read in, a verdict on each out.

A number of a form of the site counts by itself. One of another preset counts once that preset is learned: several
plates show it, and most plates do. One that may be a year or a range counts where several other plates have a number
that differs from it in the last two letters only. A site that names its forms keeps to them, and learns none. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from common.config import PoiSection
from onboard.poi.signs.number_forms import RoomNumber, site_forms

PLATES_MIN = 6  # different numbers of one form, from which it is learned
MOST = 0.6  # share of that form in all different numbers
BACKING_MIN = 4  # other plates that back a number which may be none
ALIKE = 2  # letters at the end in which those differ from it


@dataclass(frozen=True, slots=True)
class SiteNumbers:
    """What is known of the site. `own`: its forms; `named`: robot.toml gives them.

    `proposed`: the form that most plates share; `keys`: form and key of the numbers that were read.
    """

    own: frozenset[str]
    named: bool
    proposed: str = ""
    keys: frozenset[tuple[str, str]] = frozenset()

    def after(self, numbers: Iterable[RoomNumber]) -> SiteNumbers:
        """With these numbers, all that were read so far; what was proposed once stays."""
        keys = frozenset((number.form, number.key) for number in numbers)
        proposed = self.proposed
        if not proposed:
            counts = {form: sum(other == form for other, _ in keys) for form, _ in keys if form not in self.own}
            form = max(counts, key=lambda form: (counts[form], form), default="")
            if form and counts[form] >= PLATES_MIN and counts[form] >= MOST * len(keys):
                proposed = form
        return SiteNumbers(self.own, self.named, proposed, keys)

    @property
    def learned(self) -> bool:
        """Numbers of the proposed form count: the site named none of its own."""
        return bool(self.proposed) and not self.named

    @property
    def proposal(self) -> str:
        """One sentence on the proposed form; empty while there is none."""
        if not self.proposed:
            return ""
        share = f"{sum(form == self.proposed for form, _ in self.keys)} of {len(self.keys)}"
        counts = "they count" if self.learned else "robot.toml names other forms, so they do not count"
        return f'{share} numbers are {self.proposed} (number_presets = ["{self.proposed}"]); {counts}.'

    def doubt(self, number: RoomNumber) -> str:
        """Why a number does not count, empty when it does."""
        if number.form not in self.own and not (self.learned and number.form == self.proposed):
            return f"the site's numbers are not {number.form}"
        if number.suspicion and self._backing(number) < BACKING_MIN:
            return f"may be {number.suspicion}"
        return ""

    def may_count(self, number: RoomNumber) -> bool:
        """Whether other plates can make it count: not where robot.toml names other forms."""
        return number.form in self.own or not self.named

    def _backing(self, number: RoomNumber) -> int:
        stem, length = number.key[:-ALIKE], len(number.key)
        return sum(
            form == number.form and key != number.key and len(key) == length and key.startswith(stem)
            for form, key in self.keys
        )


def site_numbers(section: PoiSection) -> SiteNumbers:
    """Nothing read yet, at a site as robot.toml describes it."""
    named = bool(section.number_presets or section.number_pattern)
    return SiteNumbers(frozenset(site_forms(section).own), named)
