"""Room numbers by the site's rules: a line of text in, the number on it out.

A line holds a number when, without the words that may stand before or behind it ("Raum 214", "#214"), it is as a whole
of a form: one of the presets that the site names, or its own pattern. Where no form takes it as it was read, letters
and digits that OCR takes for one another are exchanged, as few as possible, where a form of the site wants the other.
What is of no form of the site but of another preset is a number too; `site_numbers.py` decides whether it counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

from common.config import PoiSection
from common.number_presets import DEFAULT_PRESETS, OWN_PATTERN, PRESETS
from common.room_number import key_of, plain, tight
from onboard.poi.signs.false_numbers import suspicion

LETTERS_MAX = 12  # no room number has more, and a site's own pattern may take time that doubles with each
TOO_COMMON = ("short",)  # forms that too much has by chance to be learned
REPAIRS_MAX = 3  # letters that are exchanged in one number
_TWO_PAIRS = re.compile("[0-9]{4}")
# Behind or before a number in East Asian buildings; the engine reads counter words that it lacks as some ideograph
_IDEOGRAPHS = "[\u2e80-\u9fff\uac00-\ud7af\uf900-\ufaff]{1,3}"


@dataclass(frozen=True, slots=True)
class RoomNumber:
    """A number as its plate shows it. `form`: the preset's name, or OWN_PATTERN. `words` stood before or behind it.

    `suspicion`: what it may be instead of a room's number, empty where nothing is known; `repairs`: exchanged letters.
    """

    shown: str
    form: str
    words: str = ""
    suspicion: str = ""
    repairs: int = 0

    @property
    def key(self) -> str:
        return key_of(self.shown)


@dataclass(frozen=True, slots=True)
class NumberForms:
    """The forms of a site by name, the other presets, the words beside a number, and what OCR takes for one another."""

    own: dict[str, re.Pattern[str]]
    foreign: dict[str, re.Pattern[str]]
    words: tuple[re.Pattern[str], ...]  # each takes what stands before or behind a number
    repairs: dict[str, str]  # read -> what it may be instead

    def match(self, line: str) -> RoomNumber | None:
        """The number on a line of text, None when there is none."""
        text = plain(line)
        core, words = self._without_words(text)
        both = (self._of_form(core, words), self._of_form(text, "") if words else None)
        found = [number for number in both if number is not None]
        # Words of the list may be letters of a number: LAB204
        return next((number for number in found if number.form in self.own), found[0] if found else None)

    def counts(self, number: RoomNumber) -> bool:
        """Whether a number counts by itself: of a form of the site, and nothing else that it may be."""
        return number.form in self.own and not number.suspicion

    def may_count(self, number: RoomNumber) -> bool:
        """Whether other plates can make it count: of a form of the site, or nothing else that it may be."""
        return number.form in self.own or not number.suspicion

    def _of_form(self, text: str, words: str) -> RoomNumber | None:
        if not 0 < len(text) <= LETTERS_MAX:
            return None
        found = _first_match(_spellings(text), self.own) or self._repaired(text)
        found = found or _first_match(_spellings(text), self.foreign) or self._parted(text)
        if found is None:
            return None
        form, shown, repairs = found
        return RoomNumber(shown, form, words, suspicion(shown, own=form == OWN_PATTERN), repairs)

    def _without_words(self, text: str) -> tuple[str, str]:
        taken = []
        for pattern in self.words:
            match = pattern.search(text)
            if match is not None and match.end() - match.start() < len(text):
                taken.append(match[0].strip(" .:"))
                text = (text[: match.start()] + text[match.end() :]).strip()
        return text, " ".join(taken)

    def _repaired(self, text: str) -> tuple[str, str, int] | None:
        """With the fewest exchanges that a form of the site takes, and None when two results differ."""
        for count in range(1, REPAIRS_MAX + 1):
            spellings = {s for r in self._exchanged(text, count) for s in _spellings(r)}
            results = {found[1]: found for s in spellings if (found := _first_match([s], self.own)) is not None}
            if results:
                form, shown, _ = min(results.values())
                return (form, shown, count) if len({key_of(r) for r in results}) == 1 else None
        return None

    def _parted(self, text: str) -> tuple[str, str, int] | None:
        """With a space between two pairs of digits, which engines overlook; None where it may be in several places."""
        parted = {text[:i] + " " + text[i:] for i in range(2, len(text) - 1) if _TWO_PAIRS.match(text, i - 2)}
        results = [found for one in parted if (found := _first_match(_spellings(one), self.own)) is not None]
        return (results[0][0], results[0][1], 1) if len(results) == 1 else None

    def _exchanged(self, text: str, count: int) -> Iterator[str]:
        """The text with so many letters exchanged; at least one digit stays as it was read."""
        places = [i for i, letter in enumerate(text) if letter.upper() in self.repairs]
        for chosen in combinations(places, count):
            if not any(_is_digit(letter) for i, letter in enumerate(text) if i not in chosen):
                continue
            for replacements in product(*(self.repairs[text[i].upper()] for i in chosen)):
                letters = list(text)
                for i, replacement in zip(chosen, replacements, strict=True):
                    letters[i] = replacement
                if not any(_is_digit(letters[i]) and _letter_follows(letters, i) for i in chosen):
                    yield "".join(letters)


def site_forms(section: PoiSection) -> NumberForms:
    """The site's forms as robot.toml gives them; presets and own pattern together, `plain` where it gives neither."""
    names = section.number_presets or (() if section.number_pattern else DEFAULT_PRESETS)
    own = {OWN_PATTERN: re.compile(section.number_pattern)} if section.number_pattern else {}
    compiled = {name: re.compile(preset.pattern) for name, preset in PRESETS.items()}
    repairs: dict[str, str] = {}
    for rule in section.number_repairs:
        read, meant = rule[0], rule[-1]
        repairs[read.upper()] = repairs.get(read.upper(), "") + meant
        if rule[1] == "<":
            repairs[meant.upper()] = repairs.get(meant.upper(), "") + read
    return NumberForms(
        own | {name: compiled[name] for name in PRESETS if name in names},
        {name: pattern for name, pattern in compiled.items() if name not in (*names, *TOO_COMMON)},
        _word_patterns(section.words_before, section.words_behind, section.room_types),
        repairs,
    )


def _word_patterns(before: Sequence[str], behind: Sequence[str], beside: Sequence[str]) -> tuple[re.Pattern[str], ...]:
    """The longest word of each list that a text begins or ends with, with the dot, colon and spaces around it."""

    def one_of(words: Sequence[str]) -> str:
        escaped = (re.escape(plain(word)) for word in sorted(words, key=len, reverse=True) if plain(word))
        return "|".join(escaped) or "(?!)"

    # A word ends where its letters do: "No" is no part of "NORD 3"
    edge = r"(?:(?<![^\W\d_])|(?![^\W\d_]))"
    first = rf"^{_IDEOGRAPHS}|^(?:(?:{one_of([*before, *beside])}){edge}[\s.:]*)+"
    last = rf"(?:[\s.:]*{edge}(?:{one_of([*behind, *beside])}))+$|{_IDEOGRAPHS}$"
    return re.compile(first, re.IGNORECASE), re.compile(last, re.IGNORECASE)


def _spellings(text: str) -> list[str]:
    """As read, in capitals and in small letters; a space stays only where it parts two digits."""
    text = tight(text)
    return list(dict.fromkeys((text, text.upper(), text.lower())))


def _first_match(spellings: Sequence[str], forms: dict[str, re.Pattern[str]]) -> tuple[str, str, int] | None:
    matches = ((name, s, 0) for name, pattern in forms.items() for s in spellings if pattern.fullmatch(s))
    return next(matches, None)


def _is_digit(letter: str) -> bool:
    return "0" <= letter <= "9"


def _letter_follows(letters: Sequence[str], i: int) -> bool:
    """A letter before a letter is no digit: the suffix SC is not 5C."""
    return i + 1 < len(letters) and letters[i + 1].isalpha()
