"""Pictures of signs as sign makers and offices set them: texts in, a flat picture with its colours out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from random import Random

from PIL import Image, ImageDraw, ImageFont

from offboard.evaluate.signs.fonts import font_for_capitals
from offboard.evaluate.signs.texts import NAMES, RESTROOMS, TYPES

Colour = tuple[int, int, int]  # red green blue
Box = tuple[float, float, float, float]  # left, top, right, bottom in pixels
DRAWN_CAPITALS_PX = 64.0  # drawn larger than it is shown, so that the scene only shrinks it
_COLOURS: tuple[tuple[Colour, Colour], ...] = (
    # plate, letters
    ((244, 243, 238), (26, 26, 30)),
    ((250, 250, 250), (30, 60, 120)),
    ((42, 50, 66), (240, 240, 234)),
    ((20, 20, 22), (235, 235, 235)),
    ((120, 30, 36), (245, 240, 235)),
    ((28, 84, 64), (240, 245, 240)),
    ((176, 180, 184), (28, 28, 30)),
    ((196, 190, 176), (90, 84, 72)),
    ((110, 112, 116), (226, 226, 224)),
    ((214, 190, 130), (60, 44, 20)),
)


class Layout(Enum):
    """How a plate arranges what it holds."""

    NUMBER = "number alone"
    TYPE_BELOW = "room type below, smaller"
    NAME_BELOW_TALL = "name below, as tall"
    NAME_ABOVE_TALL = "name above, as tall"
    NAME_BESIDE = "name on the number's line"
    PICTOGRAM = "pictogram beside"
    RESTROOM = "restroom word"
    TWO_LINES = "number on two lines"
    NAMES_BELOW = "several names below"
    TYPE_ABOVE = "room type above, smaller"


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a sign; `share` is the height of its capitals over the number's."""

    text: str
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class Drawn:
    """A flat sign. `letters` are the boxes of the number's characters without spaces."""

    picture: Image.Image
    back: Colour
    letters: tuple[Box, ...]


def plate_lines(layout: Layout, number: str, rng: Random) -> tuple[list[Line], int]:
    """The lines of a plate from the top, and which of them begins with the number."""
    small = rng.uniform(0.4, 0.65)
    below = {
        Layout.TYPE_BELOW: [Line(rng.choice(TYPES), small)],
        Layout.NAME_BELOW_TALL: [Line(rng.choice(NAMES), rng.uniform(0.9, 1.05))],
        Layout.RESTROOM: [Line(rng.choice(RESTROOMS), rng.uniform(0.7, 1.05))],
        Layout.NAMES_BELOW: [Line(name, 0.45) for name in rng.sample(NAMES, rng.randrange(2, 5))],
    }
    above = {
        Layout.NAME_ABOVE_TALL: [Line(rng.choice(NAMES), rng.uniform(0.9, 1.05))],
        Layout.TYPE_ABOVE: [Line(rng.choice(TYPES), small)],
    }.get(layout, [])
    return [*above, Line(number), *below.get(layout, [])], len(above)


def halves(number: str) -> tuple[str, str] | None:
    """The number on two lines of at least two letters, parted at a separator; None for a number without one there."""
    for i, c in enumerate(number):
        if 1 < i < len(number) - 2 and c in "-./| ":
            return number[:i], number[i + 1 :]
    return None


def draw_plate(layout: Layout, number: str, font: str, rng: Random) -> Drawn:
    """A plate in a random style; `number` is cut in two for Layout.TWO_LINES, which needs a separator."""
    back, front = rng.choice(_COLOURS)
    lines, at = plate_lines(layout, number, rng)
    parts = halves(number) if layout is Layout.TWO_LINES else None
    if parts is not None:
        lines = [Line(parts[0]), Line(parts[1])]
    beside = rng.choice(NAMES) if layout is Layout.NAME_BESIDE else ""
    icon = layout is Layout.PICTOGRAM or (layout is Layout.RESTROOM and rng.random() < 0.5)
    left = layout is not Layout.NUMBER and rng.random() < 0.4
    margins = rng.uniform(0.6, 1.6), rng.uniform(0.5, 1.3)  # in capitals, beside and above
    return _draw(lines, at, font, (back, front), rng, beside=beside, icon=icon, left=left, margins=margins)


def draw_notice(texts: tuple[str, ...], font: str, rng: Random) -> Drawn:
    """A sign that is no plate: the first line largest, or all alike."""
    first = rng.choice((1.0, 1.0, 1.4))
    lines = [Line(text, first if i == 0 else 1.0) for i, text in enumerate(texts)]
    return _draw(lines, 0, font, rng.choice(_COLOURS), rng, left=rng.random() < 0.3)


def _draw(
    lines: list[Line], at: int, font_name: str, colours: tuple[Colour, Colour], rng: Random,
    beside: str = "", icon: bool = False, left: bool = False, margins: tuple[float, float] = (0.8, 0.8),
) -> Drawn:  # fmt: skip
    """Sets the lines below one another, `beside` and the pictogram on the line `at`."""
    back, front = colours
    cap = DRAWN_CAPITALS_PX
    fonts = [font_for_capitals(font_name, round(line.share * cap)) for line in lines]
    widths = [font.getlength(line.text) for font, line in zip(fonts, lines, strict=True)]
    gap_px = cap * rng.uniform(0.9, 1.8)
    own_px = widths[at]
    icon_px = 1.3 * cap + 0.5 * cap if icon else 0.0
    widths[at] += icon_px + (gap_px + fonts[at].getlength(beside) if beside else 0.0)
    side_px, rim_px = margins[0] * cap, margins[1] * cap
    pitch = rng.uniform(0.55, 0.9)  # of the gaps between lines, in the higher one's capitals
    gaps = [pitch * cap * max(a.share, b.share) for a, b in pairwise(lines)] + [0.0]
    height_px = sum(line.share * cap + gap for line, gap in zip(lines, gaps, strict=True)) + 2 * rim_px
    picture = Image.new("RGB", (round(max(widths) + 2 * side_px), round(height_px)), back)
    draw = ImageDraw.Draw(picture)
    if rng.random() < 0.5:
        mid = tuple((b + f) // 2 for b, f in zip(back, front, strict=True))
        draw.rectangle((2, 2, picture.width - 3, picture.height - 3), outline=mid, width=2)
    y, letters = rim_px, []
    for i, (line, font, width, gap) in enumerate(zip(lines, fonts, widths, gaps, strict=True)):
        x = side_px if left else (picture.width - width) / 2
        if i == at:
            if icon:
                _pictogram(draw, x, y - 0.15 * cap, 1.3 * cap, front)
                x += icon_px
            letters = _letter_boxes(line.text, font, x, y)
            if beside:
                _text(draw, beside, font, x + own_px + gap_px, y, front)
        _text(draw, line.text, font, x, y, front)
        y += line.share * cap + gap
    return Drawn(picture, back, tuple(letters))


def _text(draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont, x: float, y: float, fill: Colour) -> None:
    """Capitals begin at y."""
    draw.text((x, y - font.getbbox("H")[1]), text, font=font, fill=fill)


def _letter_boxes(text: str, font: ImageFont.FreeTypeFont, x: float, y: float) -> list[Box]:
    top, boxes = font.getbbox("H")[1], []
    for i, c in enumerate(text):
        if c != " ":
            x0, y0, x1, y1 = font.getbbox(c)
            at = x + font.getlength(text[:i])
            boxes.append((at + x0, y + y0 - top, at + x1, y + y1 - top))
    return boxes


def _pictogram(draw: ImageDraw.ImageDraw, x: float, y: float, size: float, fill: Colour) -> None:
    """A standing person, as on doors of restrooms."""
    head, middle = 0.13 * size, x + size / 2
    draw.ellipse((middle - head, y, middle + head, y + 2 * head), fill=fill)
    draw.polygon(
        [(middle - 0.2 * size, y + 0.32 * size), (middle + 0.2 * size, y + 0.32 * size),
         (middle + 0.28 * size, y + 0.68 * size), (middle - 0.28 * size, y + 0.68 * size)], fill=fill,
    )  # fmt: skip
    for side in (-0.1, 0.03):
        draw.rectangle((middle + side * size, y + 0.66 * size, middle + (side + 0.07) * size, y + size), fill=fill)
