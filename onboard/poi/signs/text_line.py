"""A line of text in a picture: what the OCR engine hands over and the layout is judged by. Pure geometry."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, sin

import numpy as np
import numpy.typing as npt

LETTER_HEIGHT = 1.6  # in widths, at most
Corners = npt.NDArray[np.float32]  # (4, 2): x, y of upper left, upper right, lower right, lower left as one reads it


@dataclass(frozen=True, slots=True)
class TextLine:
    """One line of text, and how sure the reading is (0 to 1, of the least certain letter or digit).

    `x_px`, `y_px`, `width_px`, `height_px`: its box before it is turned round its middle by `angle_rad` (clockwise in
    the picture). `strokes_px`: height of its digits and capitals by their strokes, 0 where they were not measured.
    `damage`: why more or other letters may stand there than were read; empty where nothing speaks for it.
    `certain`: the confidence of each character but spaces; empty where only the line's is known.
    """

    text: str
    confidence: float
    x_px: float
    y_px: float
    width_px: float
    height_px: float
    angle_rad: float = 0.0
    strokes_px: float = 0.0
    damage: str = ""
    certain: tuple[float, ...] = ()

    @property
    def right_px(self) -> float:
        return self.x_px + self.width_px

    @property
    def bottom_px(self) -> float:
        return self.y_px + self.height_px

    @property
    def middle(self) -> tuple[float, float]:
        return self.x_px + self.width_px / 2, self.y_px + self.height_px / 2

    @property
    def letter_px(self) -> float:
        """Height of its letters; without strokes by the box, which may reach to the rim: letters are not so narrow."""
        if self.strokes_px > 0.0:
            return self.strokes_px
        return min(self.height_px, LETTER_HEIGHT * self.width_px / max(len(self.text), 1))

    def confidence_of(self, part: str) -> float:
        """Of a part of the text as read, of the whole line where it does not hold that part."""
        line, part = (re.sub(r"\s", "", text).upper() for text in (self.text, part))
        begin = line.rfind(part)
        if begin < 0 or len(line) != len(self.certain):
            return self.confidence
        return least_certain(part, self.certain[begin : begin + len(part)])

    @property
    def corners(self) -> Corners:
        x, y = self.middle
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        half = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        offsets = [(0.5 * i * self.width_px, 0.5 * j * self.height_px) for i, j in half]
        return np.array([(x + u * c - v * s, y + u * s + v * c) for u, v in offsets], np.float32)

    def turned(self, angle_rad: float) -> TextLine:
        """As in a picture that is turned round its origin by -angle_rad: lines of that angle lie level there."""
        x, y = self.middle
        c, s = cos(angle_rad), sin(angle_rad)
        u, v = x * c + y * s, -x * s + y * c
        return TextLine(
            self.text, self.confidence, u - self.width_px / 2, v - self.height_px / 2, self.width_px, self.height_px,
            self.angle_rad - angle_rad, self.strokes_px, self.damage, self.certain,
        )  # fmt: skip


def least_certain(text: str, certain: Sequence[float]) -> float:
    """The lowest confidence of its letters and digits; dots and dashes are always less certain, and seldom wrong."""
    pairs = list(zip(text, certain, strict=True))
    return min((c for letter, c in pairs if letter.isalnum()), default=min(certain, default=0.0))


def box_of(corners: Corners) -> tuple[float, float, float, float, float]:
    """x, y, width, height, angle of `TextLine` from four corners, which need not be quite a rectangle."""
    along = (corners[1] + corners[2] - corners[0] - corners[3]) / 2
    down = (corners[3] + corners[2] - corners[0] - corners[1]) / 2
    width, height = hypot(*along), hypot(*down)
    x, y = corners.mean(axis=0)
    return float(x - width / 2), float(y - height / 2), width, height, atan2(along[1], along[0])


def common_angle_rad(lines: Sequence[TextLine]) -> float:
    """The direction in which most of the text runs, by its length."""
    x = sum(line.width_px * cos(2 * line.angle_rad) for line in lines)
    y = sum(line.width_px * sin(2 * line.angle_rad) for line in lines)
    return atan2(y, x) / 2 if lines else 0.0


def around(lines: Sequence[TextLine]) -> tuple[float, float, float, float]:
    """x, y, width, height of the upright box around all of them."""
    corners = np.concatenate([line.corners for line in lines])
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    return float(x0), float(y0), float(x1 - x0), float(y1 - y0)
