"""Pictures of number plates and posters, as a sign maker would set them: texts and sizes in, Pillow images out."""

from __future__ import annotations

from functools import cache
from random import Random

from PIL import Image, ImageDraw, ImageFilter, ImageFont

from common.json_reader import Colour
from offboard.simulator.building.floor import Plate, Poster

PLATE_PX_PER_M = 1600.0  # a little finer than the camera sees it from 1 m
POSTER_PX_PER_M = 1000.0
ROOM_TYPE_SHARE = 0.6  # height of the room type's capitals over the number's
_TEXT_SHARE = 0.9  # of the plate that texts may fill

_PLATE_COLOURS: dict[str, tuple[Colour, Colour]] = {
    "light on dark": ((42, 50, 66), (240, 240, 234)),
    "dark on light": ((244, 243, 238), (26, 26, 30)),
    "dark on metal": ((176, 180, 184), (28, 28, 30)),
}
_POSTER_COLOURS: tuple[tuple[Colour, Colour], ...] = (
    ((250, 236, 190), (120, 30, 30)),
    ((206, 226, 244), (24, 50, 110)),
    ((250, 250, 248), (190, 40, 40)),
    ((216, 238, 208), (30, 90, 40)),
    ((60, 70, 120), (245, 240, 220)),
)


@cache
def _font(size_px: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size_px)
    if not isinstance(font, ImageFont.FreeTypeFont):
        raise RuntimeError("Pillow was built without FreeType: install Pillow from PyPI")
    return font


def _font_for_capitals(height_px: float) -> ImageFont.FreeTypeFont:
    top, bottom = _font(200).getbbox("H")[1::2]
    return _font(max(round(200.0 * height_px / (bottom - top)), 4))


def draw_plate(plate: Plate, number: str, room_type: str) -> Image.Image:
    """The plate as one reads it: the number, and below it the room type where there is one."""
    width_px, height_px = round(plate.width_m * PLATE_PX_PER_M), round(plate.height_m * PLATE_PX_PER_M)
    back, front = _PLATE_COLOURS.get(plate.style, _PLATE_COLOURS["dark on light"])
    image = Image.new("RGB", (width_px, height_px), back)
    if plate.style == "dark on metal":
        image = _brushed(image)
    draw = ImageDraw.Draw(image)
    rim = tuple((b + f) // 2 for b, f in zip(back, front, strict=True))
    draw.rectangle((0, 0, width_px - 1, height_px - 1), outline=rim, width=2)
    number_px = plate.number_height_m * PLATE_PX_PER_M
    lines = [(number, number_px)] + ([(room_type, ROOM_TYPE_SHARE * number_px)] if room_type else [])
    gap_px = 0.4 * number_px
    needed_px = sum(height for _, height in lines) + gap_px * (len(lines) - 1)
    shrink = min(_TEXT_SHARE * height_px / needed_px, 1.0)
    y_px = (height_px - shrink * needed_px) / 2
    for text, text_px in lines:
        _centred(draw, text, width_px, y_px, shrink * text_px, front)
        y_px += shrink * (text_px + gap_px)
    return image


def _centred(draw: ImageDraw.ImageDraw, text: str, width_px: int, y_px: float, height_px: float, fill: Colour) -> None:
    """One line whose capitals begin at y_px, made smaller if it is too wide."""
    font = _font_for_capitals(height_px)
    if font.getlength(text) > _TEXT_SHARE * width_px:
        font = _font_for_capitals(height_px * _TEXT_SHARE * width_px / font.getlength(text))
    top_px = font.getbbox("H")[1]
    draw.text(((width_px - font.getlength(text)) / 2, y_px - top_px), text, font=font, fill=fill)


def _brushed(image: Image.Image) -> Image.Image:
    """Fine lines along the plate, as on brushed metal."""
    rng = Random(image.width * 7919 + image.height)
    shades = Image.new("L", (1, image.height))
    shades.putdata([128 + rng.randrange(-14, 15) for _ in range(image.height)])
    streaks = Image.merge("RGB", [shades.resize(image.size)] * 3)
    return Image.blend(image, streaks, 0.25)


def draw_poster(poster: Poster, rng: Random) -> Image.Image:
    """A poster with its text in large letters, and a picture that is none."""
    width_px, height_px = round(poster.width_m * POSTER_PX_PER_M), round(poster.height_m * POSTER_PX_PER_M)
    back, front = rng.choice(_POSTER_COLOURS)
    image = Image.new("RGB", (width_px, height_px), back)
    draw = ImageDraw.Draw(image)
    for _ in range(rng.randrange(3, 7)):
        x0, y0 = rng.uniform(0.1, 0.6) * width_px, rng.uniform(0.55, 0.8) * height_px
        shade: Colour = (rng.randrange(60, 220), rng.randrange(60, 220), rng.randrange(60, 220))
        draw.ellipse(
            (x0, y0, x0 + rng.uniform(0.1, 0.3) * width_px, y0 + rng.uniform(0.05, 0.15) * height_px), fill=shade
        )
    y_px, line_px = 0.08 * height_px, 0.06 * height_px
    for line in _wrapped(poster.text, 12):
        _centred(draw, line, width_px, y_px, line_px, front)
        y_px += 1.8 * line_px
    return image


def _wrapped(text: str, columns: int) -> list[str]:
    lines: list[str] = []
    for word in text.split():
        if lines and len(lines[-1]) + 1 + len(word) <= columns:
            lines[-1] += " " + word
        else:
            lines.append(word)
    return lines


def with_glare(image: Image.Image, rng: Random) -> Image.Image:
    """The reflection of a lamp across part of a plate."""
    mask = Image.new("L", image.size)
    x_px, y_px = rng.uniform(0.1, 0.9) * image.width, rng.uniform(0.1, 0.9) * image.height
    radius_px = rng.uniform(0.2, 0.4) * image.height
    ImageDraw.Draw(mask).ellipse((x_px - radius_px, y_px - radius_px, x_px + radius_px, y_px + radius_px), fill=220)
    mask = mask.filter(ImageFilter.GaussianBlur(0.4 * radius_px))
    return Image.composite(Image.new("RGB", image.size, (255, 255, 250)), image, mask)
