"""The strokes of a line of text: how high its letters are, where they stand, and what runs through them.

Here a line is taken apart without knowing what it says; `line_check.py` compares that with what was read.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from onboard.poi.camera.frame import Gray

ROWS = 64  # of the line's box in the picture that is looked at
STROKE_MAX = 23  # rows or columns: no stroke of a letter is wider
THRESHOLDS = (0.8, 1.1, 1.4)  # of Otsu's level: where light falls on a plate, letters are fainter
CAPITAL_MIN = 0.35  # height of capitals over that of their box
LOW = 0.45  # height of the lowest letter that is no dot or dash, in capitals
RIM = 8  # rows and columns around the box in which strokes are followed
AREA_MIN = 12  # pixels of a stroke
DOT_ABOVE, DOT_BELOW = 0.4, 0.15  # as far from the letters dots and accents stand, in their height
SPECK = 0.16  # height of the highest letter: lower ones are dots, dashes and dirt


@dataclass(frozen=True, slots=True)
class Letter:
    """A connected stroke, or several above one another, in pixels of the line's own picture.

    `contrast` is that of its clearest part against the background around it.
    """

    x: float
    y: float
    width: float
    height: float
    contrast: float

    @property
    def right(self) -> float:
        return self.x + self.width

    @property
    def bottom(self) -> float:
        return self.y + self.height

    def merged(self, other: Letter) -> Letter:
        x, y = min(self.x, other.x), min(self.y, other.y)
        width, height = max(self.right, other.right) - x, max(self.bottom, other.bottom) - y
        return Letter(x, y, width, height, max(self.contrast, other.contrast))


@dataclass(frozen=True, slots=True)
class Strokes:
    """A line taken apart; its picture has ROWS of the line's box and `margin` around it.

    `gray` is that picture; `ink` is how much each pixel stands out from `back`, the background around it, in grey
    values and in the letters' direction; `contrast` is the letters' ink. `letters` from left to right; `crossing` marks
    strokes that run out of the box above or below, as letters do not. `capital` is the height of most of the higher
    letters, 0 without any.
    """

    gray: Gray
    ink: Gray
    back: Gray
    contrast: float
    margin: int
    letters: tuple[Letter, ...]
    crossing: npt.NDArray[np.bool_]
    capital: float


def strokes(picture: Gray, margin: int, characters: int = 0, flat: int = 0) -> Strokes:
    """Takes a level line apart whose box has `margin` pixels around it.

    Where that gives fewer letters than `characters`, which blur may have joined, fainter parts are left out. `flat` of
    them are dots and dashes.
    """
    scale = ROWS / (picture.shape[0] - 2 * margin)
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    gray = cv2.GaussianBlur(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=interpolation), (0, 0), 1.0)
    m = round(margin * scale)
    inner = gray[m : m + ROWS, m : gray.shape[1] - m]
    level, _ = cv2.threshold(inner, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    # Above and below the letters is their background, or what is beyond the plate; among them most is background
    rim, middle = np.concatenate([inner[:5], inner[-5:]]), inner[ROWS // 4 : -ROWS // 4]
    dark = bool(np.mean(rim > level) + np.mean(middle > level) >= 1.0)
    taken = _taken_apart(gray, m, dark, characters)
    high = max(characters - flat, 0)
    # The box may reach beyond a plate that is darker than its wall. One of many may be two that touch, or was not read
    allowed = 1 if high > 2 else 0
    if _misses(taken, high) > allowed:
        other = _taken_apart(gray, m, not dark, characters)
        return other if _misses(other, high) + allowed < _misses(taken, high) else taken
    return taken


def _misses(taken: Strokes, high: int) -> int:
    """How many letters more or less it has than characters as high as letters are; all of them where none is."""
    if taken.capital < CAPITAL_MIN * ROWS:
        return max(high, 1)
    return abs(sum(letter.height >= LOW * taken.capital for letter in taken.letters) - high)


def _taken_apart(gray: Gray, m: int, dark: bool, characters: int) -> Strokes:
    """With letters darker than their background, or lighter."""
    # Light and shade change slowly; a stroke is narrower than what is left of it
    kernel = np.ones((STROKE_MAX, STROKE_MAX), np.uint8)
    back = cv2.morphologyEx(gray, cv2.MORPH_CLOSE if dark else cv2.MORPH_OPEN, kernel)
    ink = cv2.subtract(back, gray) if dark else cv2.subtract(gray, back)
    level, _ = cv2.threshold(ink[m : m + ROWS, m : gray.shape[1] - m], 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    followed = slice(m - RIM, m + ROWS + RIM), slice(m - RIM, gray.shape[1] - m + RIM)
    best: tuple[list[Letter], npt.NDArray[np.bool_]] | None = None
    for threshold in THRESHOLDS:
        crossing = np.zeros(gray.shape, np.bool_)
        mask = (ink[followed] > threshold * level).astype(np.uint8)
        found = _connected(ink[followed], mask, m - RIM, crossing[followed])
        if best is None or len(found) > len(best[0]):
            best = found, crossing
        if len(best[0]) >= characters:
            break
    assert best is not None
    found, crossing = best
    heights = [one.height for one in found if one.height >= 0.5 * max(other.height for other in found)]
    capital = float(np.percentile(heights, 75)) if heights else 0.0
    letters = tuple(one for one in found if one.height >= SPECK * capital or one.width >= SPECK * capital)
    contrast = float(np.median([one.contrast for one in letters])) if letters else 1.0
    return Strokes(gray, ink, back, max(contrast, 1.0), m, letters, crossing, capital)


def _connected(ink: Gray, mask: npt.NDArray[np.uint8], offset: int, crossing: npt.NDArray[np.bool_]) -> list[Letter]:
    """The letters; strokes that are none are marked in `crossing`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    strokes: list[Letter] = []
    for i, (x, y, w, h, area) in enumerate(stats.tolist()):
        if i == 0 or area < AREA_MIN:
            continue
        own = labels[y : y + h, x : x + w] == i
        if y == 0 or y + h == ink.shape[0]:
            crossing[y : y + h, x : x + w] |= own
        elif x > 0 and x + w < ink.shape[1]:  # otherwise of what is beside the line
            contrast = float(np.percentile(ink[y : y + h, x : x + w][own], 80))
            strokes.append(Letter(x + offset, y + offset, w, h, contrast))
    return _letters_of(strokes)


def _letters_of(strokes: list[Letter]) -> list[Letter]:
    """Strokes above one another become one letter, without those of the lines above and below."""
    tall = [one for one in strokes if one.height >= 0.6 * max(other.height for other in strokes)]
    if not tall:
        return []
    top, bottom = float(np.median([one.y for one in tall])), float(np.median([one.bottom for one in tall]))
    high = bottom - top
    letters: list[Letter] = []
    for one in sorted(strokes, key=lambda one: (one.x, one.y)):
        middle = one.y + one.height / 2
        if not top - DOT_ABOVE * high < middle < bottom + DOT_BELOW * high:
            continue
        if letters and one.x < letters[-1].right - 0.5 * min(one.width, letters[-1].width):
            letters[-1] = letters[-1].merged(one)
        else:
            letters.append(one)
    return letters
