"""Whether a line of text shows all that was read and nothing else: what the engine read, against the line's strokes.

An engine is certain of half a letter: 824 whose first digit is half hidden reads 324 at 1.000. So a reading counts only
where the line is free on all sides, its digits are of one height and on one line, none of them is much narrower or
fainter than the others, and none is missing between them. Lengths are shares of the height of a capital.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from onboard.poi.signs.cover_edges import TOUCHING, edges_along
from onboard.poi.signs.letters import CAPITAL_MIN, LOW, ROWS, Letter, Strokes

BESIDE_FREE, ABOVE_FREE = 0.2, 0.15  # room beside the outer letters; above and below all of them
NEAR = 0.08  # as far as blur reaches
INWARD = 0.3  # as far an edge that runs askew may be seen within the letters
EDGE = 0.15  # as far as an edge is blurred; light changes more slowly
SHARPER = 3.0  # than the usual change of the background around it
STEP = 0.25  # of the background within that room, share of the letters' contrast: the border of something
CENTRED = 0.12  # difference of the room on both sides of a number that fills a narrow plate
CLEAR = 0.06  # room that the letters of such a number leave at least
SAME_STEP = 0.3  # of its two borders
DIFFERS = 0.35  # from the background, share of the letters' contrast: something stands there
COLUMN_BUSY = 0.12  # share of a column that differs
CROSSED = 0.1  # columns in which something runs through the line
GAP_MAX, GAP_TIMES = 0.5, 2.0  # between letters of one word: absolute, and in usual gaps
HEIGHT_OFF, FOOT_OFF = 0.14, 0.14  # of a digit from the others
DIGIT_WIDE = 0.5  # usual digits but 1 are wider; separators are narrower
NARROW = 0.62  # share of the usual digit's width; "1" is left out
FAINT = 0.45  # share of the usual letter's contrast
RUNNING_TOGETHER = 0.6  # letters per character: from there on each letter is not seen by itself
ICON_GAP, ICON_HEIGHT, ICON_OFF = 0.25, 1.15, 0.16  # a pictogram beside the line: apart, higher, or not on its foot
DASH_MAX, DASH_BETWEEN = 0.3, (0.3, 0.75)  # height of a dash, and where its middle is, from above
FRAME, ROOM = 0.35, 0.9  # around letters in a box that fits them; where the box holds something else, too
BLOCK = 0.5  # step of the background there, share of the letters' contrast
UNREAD_GAP, WORDS_APART = 0.4, 0.8  # gaps: beside a letter that was not read; between a number and a name
Profile = npt.NDArray[np.float32]  # (N,), grey

FLAT = frozenset("-–—.·•:,'´`_~\"")
_DIGITS = frozenset("0123456789")


@dataclass(frozen=True, slots=True)
class Character:
    """One character as read."""

    text: str
    confidence: float


@dataclass(frozen=True, slots=True)
class Checked:
    """`capital`: height of digits and capitals, share of the box. `damage`: why the reading may not be the whole text.

    `parts`: begin and end, shares of the box, of what has to be read by itself; empty when the line is of one piece.
    `rows`: the same from above, where the letters are so much lower than their box that small strokes are lost.
    """

    capital: float
    damage: str = ""
    parts: tuple[tuple[float, float], ...] = ()
    rows: tuple[float, float] = (0.0, 1.0)


def checked(line: Strokes, characters: Sequence[Character]) -> Checked:
    """Compares a reading with the strokes."""
    letters = [c for c in characters if c.text != " "]
    spaces = len(characters) - len(letters)
    if not line.letters:
        return Checked(0.0, "covered" if line.crossing.any() else "no strokes")
    own = _letter_of_each(line, letters)
    high = [a.height for a, c in zip(own, letters, strict=True) if c.text in _DIGITS or c.text.isupper()] if own else []
    capital = float(np.median(high)) if high else line.capital
    parts = _parts(line, capital, len(letters), spaces)
    return Checked(capital / ROWS, _damage(line, capital, own, letters, spaces), parts, _rows(line, capital))


def _rows(line: Strokes, capital: float) -> tuple[float, float]:
    if capital >= CAPITAL_MIN * ROWS:
        return 0.0, 1.0
    _, _, top, bottom = _extent(line, capital)
    above, below = ((end - line.margin) / ROWS for end in (top - FRAME * capital, bottom + FRAME * capital))
    return max(above, 0.0), min(below, 1.0)


def _letter_of_each(line: Strokes, characters: Sequence[Character]) -> tuple[Letter, ...] | None:
    """The letter of every character; None when they are not as many, or a digit would be as low as a dot."""
    if len(line.letters) != len(characters):
        return None
    pairs = zip(line.letters, characters, strict=True)
    low = any(c.text not in FLAT and a.height < LOW * line.capital for a, c in pairs)
    return None if low else line.letters


def _parts(line: Strokes, capital: float, characters: int, spaces: int) -> tuple[tuple[float, float], ...]:
    """Where to cut the line: at a pictogram on either side, and at a gap that is no space between words."""
    letters = list(line.letters)
    width = line.ink.shape[1] - 2 * line.margin
    if len(letters) < 2:
        return ()
    first, last = 0, len(letters)
    apart = sum(b.x - a.right > UNREAD_GAP * capital for a, b in pairwise(letters)) > spaces
    for side in (-1, 1):
        while last - first > 1:
            rest = letters[first + 1 : last] if side < 0 else letters[first : last - 1]
            one = letters[first] if side < 0 else letters[last - 1]
            if not _is_icon(one, rest, capital, apart and last - first > characters):
                break
            first, last = (first + 1, last) if side < 0 else (first, last - 1)
    cuts = [i for i in range(first + 1, last) if letters[i].x - letters[i - 1].right > WORDS_APART * capital]
    icon = _solid(line, capital, line.margin, letters[0].x) or _solid(
        line, capital, letters[-1].right, line.margin + width
    )
    if not cuts and not icon and (first, last) == (0, len(letters)):
        return ()
    bounds = [first, *cuts, last]
    spans = []
    for a, b in pairwise(bounds):
        left = 0.0 if a == 0 else (letters[a].x + letters[a - 1].right) / 2 - line.margin
        right = float(width) if b == len(letters) else (letters[b].x + letters[b - 1].right) / 2 - line.margin
        left = max(left, letters[a].x - line.margin - 0.25 * capital)
        right = min(right, letters[b - 1].right - line.margin + 0.25 * capital)
        spans.append((max(left, 0.0) / width, min(right, width) / width))
    return tuple(spans)


def _solid(line: Strokes, capital: float, begin: float, end: float) -> bool:
    """A pictogram too solid to be a stroke, between the box's end and the letters."""
    if end - begin < ROOM * capital:
        return False
    middle = line.margin + ROWS / 2
    rows = slice(round(middle - 0.3 * capital), round(middle + 0.3 * capital))
    profile = np.median(line.back[rows, round(begin) : round(end - NEAR * capital)].astype(np.float32), axis=0)
    return float(np.ptp(profile)) > BLOCK * line.contrast


def _is_icon(one: Letter, rest: Sequence[Letter], capital: float, unread: bool) -> bool:
    """A pictogram stands apart from the letters, and is higher, or not on their line, or not read as one."""
    foot = float(np.median([a.bottom for a in rest if a.height >= 0.6 * capital] or [one.bottom]))
    gap = max(rest[0].x - one.right, one.x - rest[-1].right)
    if gap < ICON_GAP * capital or one.height < 0.6 * capital:
        return False
    off = max(one.bottom - foot, foot - capital - one.y)
    return unread or one.height > ICON_HEIGHT * capital or off > ICON_OFF * capital


def _damage(
    line: Strokes, capital: float, own: Sequence[Letter] | None, characters: Sequence[Character], spaces: int
) -> str:
    x0, x1, top, bottom = _extent(line, capital)
    core = slice(round(top + 0.1 * capital), round(bottom - 0.1 * capital))
    through = line.crossing[core, round(x0) : round(x1)].any(axis=0)
    if through.sum() > CROSSED * capital:
        return "something runs through the letters"
    if len(line.letters) == 1 and len(characters) > 1:
        return "no letters apart"
    if len(line.letters) > len(characters) and any(
        _is_dash(letter, top, capital) and character.text not in FLAT
        for letter, character in ((line.letters[0], characters[0]), (line.letters[-1], characters[-1]))
    ):
        return "a dash that was not read"
    return (
        _covered(line, capital, characters)
        or _missing(line, capital, own, characters, spaces)
        or _uneven(line, own, characters)
    )


def _is_dash(letter: Letter, top: float, capital: float) -> bool:
    """A stroke about the middle of the letters: "-1.05" and "1.05" are two rooms."""
    low, high = (top + share * capital for share in DASH_BETWEEN)
    return letter.height < DASH_MAX * capital and low < letter.y + letter.height / 2 < high


def _extent(line: Strokes, capital: float) -> tuple[float, float, float, float]:
    """Left and right end of the letters, and top and bottom of the high ones."""
    tall = [a for a in line.letters if a.height >= 0.6 * capital] or list(line.letters)
    return line.letters[0].x, line.letters[-1].right, min(a.y for a in tall), max(a.bottom for a in tall)


def _covered(line: Strokes, capital: float, characters: Sequence[Character]) -> str:
    """Whether anything touches the line from a side: half a letter, or the border of what hides the rest of it."""
    x0, x1, top, bottom = _extent(line, capital)
    rows = slice(max(round(top + 0.1 * capital), 0), round(bottom - 0.1 * capital) + 1)
    columns = slice(max(round(x0), 0), round(x1) + 1)
    inked = (line.ink[rows] > DIFFERS * line.contrast).mean(axis=0) > COLUMN_BUSY
    across = np.median(line.back[rows].astype(np.float32), axis=0)
    down = np.median(line.back[:, columns].astype(np.float32), axis=1)
    near, far = round(NEAR * capital), round(BESIDE_FREE * capital)
    left, right = slice(max(round(x0) - far, 0), max(round(x0) - near, 0)), slice(round(x1) + near, round(x1) + far)
    if inked[left].any() or inked[right].any():
        return "another stroke beside the letters"
    step, reach, inward = STEP * line.contrast, max(round(EDGE * capital), 1), INWARD * capital
    close = [
        side
        for side, profile, end, way, free in (
            ("left", across, x0, -1, far),
            ("right", across, x1, 1, far),
            ("above", down, top, -1, ABOVE_FREE * capital),
            ("below", down, bottom, 1, ABOVE_FREE * capital),
        )
        if (edge := _edge(profile, (end - way * inward, end + way * free), reach, capital, step)) is not None
        # Above and below no letters can be hidden but these, which it then touches
        and (profile is across or way * (edge[0] - end) < TOUCHING * capital)
    ]
    close += edges_along(line, capital)
    if ("left" in close or "right" in close) and _in_the_middle(
        across, (x0, x1), _room_of_ones(line, capital, characters), capital, step
    ):
        close = [side for side in close if side not in ("left", "right")]
    return next((f"an edge close {side}" for side in close), "")


def _room_of_ones(line: Strokes, capital: float, characters: Sequence[Character]) -> tuple[float, float]:
    """How much room a 1 may leave beside it at the left and right end, since it is set as wide as another digit."""
    wide = [a.width for a in line.letters if a.width > DIGIT_WIDE * capital]
    usual = float(np.median(wide)) if wide else 0.0
    ends = (line.letters[0], characters[0]), (line.letters[-1], characters[-1])
    left, right = (max(usual - a.width, 0.0) / 2 if c.text == "1" else 0.0 for a, c in ends)
    return left, right


def _in_the_middle(
    across: Profile, ends: tuple[float, float], more: tuple[float, float], capital: float, step: float
) -> bool:
    """Whether letters between these ends have like borders on both sides, as a number that fills a narrow plate.

    What covers a line has one border, and that is at the letters. Looked for further out than a border may be near,
    since of one on the limit only a part would count. On each side there may be so much `more` room.
    """
    reach, out = max(round(EDGE * capital), 1), (BESIDE_FREE + EDGE + CENTRED) * capital
    inward = INWARD * capital
    borders = [
        _edge(across, (end - way * inward, end + way * (out + room)), reach, capital, step)
        for end, way, room in zip(ends, (-1.0, 1.0), more, strict=True)
    ]
    if borders[0] is None or borders[1] is None:
        return False
    (left_at, left_step), (right_at, right_step) = borders[0], borders[1]
    beside = ends[0] - left_at, right_at - ends[1]
    same = -more[1] - CENTRED * capital < beside[0] - beside[1] < more[0] + CENTRED * capital
    return same and abs(left_step - right_step) < SAME_STEP * abs(left_step) and min(beside) > CLEAR * capital


def _edge(
    profile: Profile, window: tuple[float, float], reach: int, capital: float, step: float
) -> tuple[float, float] | None:
    """Where the background changes within the window of a profile (N,), and by how much outwards; None where evenly."""
    a, b = (max(round(end), 0) for end in sorted(window))
    changes = profile[reach:] - profile[:-reach]
    steps = np.abs(changes)
    close = steps[a : max(b + 1 - reach, a + 1)]
    if not close.size:
        return None
    # Light that falls on a plate changes the background all along the line
    usual = float(np.median(steps[max(a - round(capital), 0) : b + round(capital)]))
    if float(close.max()) <= max(step, SHARPER * usual):
        return None
    at = a + int(close.argmax())
    outwards = 1.0 if window[1] > window[0] else -1.0
    return at + reach / 2, outwards * float(changes[at])


def _missing(
    line: Strokes, capital: float, own: Sequence[Letter] | None, characters: Sequence[Character], spaces: int
) -> str:
    """A gap like that between words where no space was read: a letter may have been erased."""
    gaps = [b.x - a.right for a, b in pairwise(line.letters)]
    limit = max(GAP_MAX * capital, GAP_TIMES * sorted(gaps)[(len(gaps) - 1) // 2]) if gaps else 0.0
    wide = [i for i, gap in enumerate(gaps) if gap > limit]
    if own is not None:  # a letter often stands apart from the digits behind it, and so does "No."
        texts = [c.text for c in characters]
        before = [next((t for t in reversed(texts[: i + 1]) if t not in FLAT), "") for i in wide]
        wide = [i for i, text in zip(wide, before, strict=True) if text.isalpha() == texts[i + 1].isalpha()]
    return "a gap between the letters" if len(wide) > spaces else ""


def _uneven(line: Strokes, own: Sequence[Letter] | None, characters: Sequence[Character]) -> str:
    if own is None:
        return ""
    digits = [(a, c) for a, c in zip(own, characters, strict=True) if c.text in _DIGITS]
    if len(digits) < 2:
        return ""
    height = float(np.median([a.height for a, _ in digits]))
    foot = float(np.median([a.bottom for a, _ in digits]))
    if any(abs(a.height - height) > HEIGHT_OFF * height or abs(a.bottom - foot) > FOOT_OFF * height for a, _ in digits):
        return "digits of different heights"
    wide = [a.width for a, c in digits if c.text != "1"]
    if wide and min(wide) < NARROW * float(np.median(wide)):
        return "a digit is too narrow"
    usual = float(np.median([a.contrast for a in own]))
    if any(a.contrast < FAINT * usual for a, c in zip(own, characters, strict=True) if c.text not in FLAT):
        return "a letter is too faint"
    return ""
