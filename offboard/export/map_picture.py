"""The sheet as SVG, and as PNG: map data and title block -> text or bytes, 1 cm on paper for 1 m in the building.

To print either, print the PDF: Chromium shrinks an SVG that is wider than its paper and cuts off the rest, which this
SVG's own page size avoids only where the paper is as large; and it ignores a PNG's resolution.
"""

from __future__ import annotations

import io
import logging
from itertools import pairwise
from math import sqrt
from xml.sax.saxutils import escape

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from common.geometry import Points
from offboard.export.letters import font_file
from offboard.export.plan import ASTERISK_MM, Stroke, make_plan
from offboard.export.sheet import Sheet, single_sheet
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import MapData

PAPER = "#ffffff"
PIXELS_PER_MM = 6.0  # 152.4 dots per inch
IMAGE_PIXELS_MAX = 36_000_000  # a square metre of paper
OVERSAMPLING = 2

_UNTITLED = TitleBlock()
_log = logging.getLogger("export")


def as_svg(data: MapData, block: TitleBlock = _UNTITLED) -> str:
    """The sheet as SVG text; the points of interest carry their name, number and room as a tooltip."""
    sheet = single_sheet(make_plan(data), block)
    size = f"{sheet.width_mm:g}mm", f"{sheet.height_mm:g}mm"

    def path(line: Points, closed: bool) -> str:
        return "M" + "L".join(f"{x:.2f} {sheet.height_mm - y:.2f}" for x, y in line.tolist()) + ("Z" if closed else "")

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" '
        f'viewBox="0 0 {sheet.width_mm:g} {sheet.height_mm:g}" font-family="sans-serif" '
        'stroke-linecap="round" stroke-linejoin="round" fill="none">',
        f"<style>@page {{ size: {size[0]} {size[1]}; margin: 0 }}</style>",
        f"<desc>{escape(sheet.description)}</desc>",
        f'<rect width="{sheet.width_mm:g}" height="{sheet.height_mm:g}" fill="{PAPER}"/>',
    ]
    for stroke in sheet.strokes:
        shape = "".join(path(line, stroke.filled) for line in stroke.lines)
        parts.append(f'<path class="{stroke.name}" {_paint(stroke)} d="{shape}"/>')
    for text in sheet.texts:
        at = f'x="{text.x_mm:.2f}" y="{sheet.height_mm - text.y_mm:.2f}" fill="{text.colour}"'
        look = f'font-size="{text.height_mm:g}" text-anchor="{text.anchor}"'
        parts.append(f"<text {at} {look}>{escape(text.text)}</text>")
    for hint in sheet.hints:
        at = f'cx="{hint.x_mm:.2f}" cy="{sheet.height_mm - hint.y_mm:.2f}" r="{1.5 * ASTERISK_MM:g}"'
        parts.append(
            f'<circle class="poi" {at} fill="{PAPER}" fill-opacity="0"><title>{escape(hint.text)}</title></circle>'
        )
    return "\n".join([*parts, "</svg>", ""])


def _paint(stroke: Stroke) -> str:
    if stroke.filled:
        return f'fill="{stroke.colour}"'
    dash = f' stroke-dasharray="{stroke.dash_mm[0]:g} {stroke.dash_mm[1]:g}"' if stroke.dash_mm else ""
    return f'stroke="{stroke.colour}" stroke-width="{stroke.width_mm:g}"{dash}'


def as_png(data: MapData, block: TitleBlock = _UNTITLED) -> bytes:
    """The sheet as PNG, PIXELS_PER_MM unless it had more than IMAGE_PIXELS_MAX then; its resolution is in the file."""
    sheet = single_sheet(make_plan(data), block)
    fitting = sqrt(IMAGE_PIXELS_MAX / (sheet.width_mm * sheet.height_mm))
    if fitting < PIXELS_PER_MM:
        _log.warning("The sheet is too large for a PNG of 150 dpi, this one has %.0f: print the PDF.", fitting * 25.4)
    scale = min(PIXELS_PER_MM, fitting)
    size = round(sheet.width_mm * scale), round(sheet.height_mm * scale)
    image = _painted(sheet, scale * OVERSAMPLING, (size[0] * OVERSAMPLING, size[1] * OVERSAMPLING))
    out = io.BytesIO()
    dpi = scale * 25.4
    image.resize(size, Image.Resampling.LANCZOS).save(out, "PNG", dpi=(dpi, dpi))
    return out.getvalue()


def _painted(sheet: Sheet, scale: float, size: tuple[int, int]) -> Image.Image:
    """`scale` in pixels per millimetre."""
    image = Image.new("RGB", size, PAPER)
    brush = ImageDraw.Draw(image)

    def place(points: Points) -> list[tuple[float, float]]:
        return [(x * scale, size[1] - y * scale) for x, y in points.tolist()]

    for stroke in sheet.strokes:
        width = max(round(stroke.width_mm * scale), 1)
        for line in map(place, stroke.lines if stroke.dash_mm is None else _dashes(stroke.lines, *stroke.dash_mm)):
            if stroke.filled:
                brush.polygon(line, fill=stroke.colour)
                continue
            brush.line(line, fill=stroke.colour, width=width, joint="curve")
            for x, y in (line[0], line[-1]) if width > 2 else ():
                brush.ellipse((x - width / 2, y - width / 2, x + width / 2, y + width / 2), fill=stroke.colour)
    anchors = {"start": "ls", "middle": "ms", "end": "rs"}
    for text in sheet.texts:
        font = ImageFont.truetype(font_file(), size=text.height_mm * scale)
        ((x, y),) = place(np.array([[text.x_mm, text.y_mm]]))
        brush.text((x, y), text.text, fill=text.colour, font=font, anchor=anchors[text.anchor])
    return image


def _dashes(lines: list[Points], dash_mm: float, gap_mm: float) -> list[Points]:
    """The dashes of polylines, each with its own straight part of them."""
    dashes = []
    for line in lines:
        for a, b in pairwise(line):
            length_mm = float(np.hypot(*(b - a)))
            starts_mm = np.arange(0.0, length_mm, dash_mm + gap_mm) if length_mm else np.zeros(1)
            along = (b - a) / length_mm if length_mm else np.zeros(2)
            dashes += [a + np.outer((s, min(s + dash_mm, length_mm)), along) for s in starts_mm.tolist()]
    return dashes
