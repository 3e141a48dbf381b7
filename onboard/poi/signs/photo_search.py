"""Where text stands in a photo of any size: a look at all of it, shrunken, then closer looks at parts.

A plate in a photo of 24 megapixels is too small to be seen in the copy that the engine looks at. Each further level
doubles the scale and looks at tiles of the same size, first at those with the most strokes. What was found is always
read at the photo's own scale. The number of tiles bounds the time.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from onboard.poi.camera.frame import Image
from onboard.poi.signs.grouping import signs
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.sign_reading import SignReading, SignRules, Verdict
from onboard.poi.signs.text_line import Corners, TextLine

CLOSER_ABOVE_PX = 1280  # longer side; a smaller photo is seen well enough as a whole
TILE_STEP = 0.8  # of a tile, so that a plate on the edge of one is inside the next
TILES_MAX = 12  # of one photo
STROKES_MIN = 0.01  # share of strong vertical strokes, below which there is no text in a tile
STROKE = 60.0  # step of brightness, by Sobel
OVERLAP = 0.3  # of two boxes, share of the smaller, from which they are the same text


def sign_readings(reader: SignReader, rules: SignRules, photo: Image, side_px: int) -> list[SignReading]:
    """All signs in a photo, places in its pixels; it is looked at more closely as long as no plate is found."""
    lines: list[TextLine] = []
    readings: list[SignReading] = []
    for boxes in text_boxes(reader, photo, side_px):
        closer = reader.read(photo, boxes)
        # A closer look reads the same text better
        lines = [line for line in lines if not any(_overlap(line.corners, new.corners) > OVERLAP for new in closer)]
        lines += closer
        readings = [rules.judge(sign) for sign in signs(lines)]
        if any(reading.verdict is Verdict.PLATE for reading in readings):
            break
    return readings


def text_boxes(reader: SignReader, photo: Image, side_px: int) -> Iterator[list[Corners]]:
    """The boxes of text that each level adds, in pixels of the photo; `side_px` is the engine's detection side."""
    longer = max(photo.shape[:2])
    scale = min(1.0, side_px / longer)
    yield reader.boxes(photo)
    left = TILES_MAX if longer > CLOSER_ABOVE_PX else 0
    while left > 0 and scale < 1.0:
        scale = min(1.0, 2 * scale)
        copy = photo
        if scale < 1.0:
            copy = np.asarray(cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        tiles = _tiles(copy, side_px)[:left]
        left -= len(tiles)
        added: list[Corners] = []
        for x, y in tiles:
            tile = np.ascontiguousarray(copy[y : y + side_px, x : x + side_px])
            for box in reader.boxes(tile):
                placed = (box + np.array([x, y], np.float32)) / np.float32(scale)
                if not any(_overlap(placed, other) > OVERLAP for other in added):
                    added.append(placed)
        yield added


def _tiles(image: Image, side_px: int) -> list[tuple[int, int]]:
    """Left upper corners of tiles with strokes, those with most of them first."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    strokes = np.abs(cv2.Sobel(gray, cv2.CV_16S, 1, 0)) > STROKE
    ranked = []
    for y in _starts(image.shape[0], side_px):
        for x in _starts(image.shape[1], side_px):
            share = float(strokes[y : y + side_px, x : x + side_px].mean())
            if share > STROKES_MIN:
                ranked.append((-share, y, x))
    return [(x, y) for _, y, x in sorted(ranked)]


def _starts(length_px: int, side_px: int) -> list[int]:
    """Where tiles begin that cover a length, the last one flush with its end."""
    if length_px <= side_px:
        return [0]
    count = int(np.ceil((length_px - side_px) / (TILE_STEP * side_px))) + 1
    return [round(i * (length_px - side_px) / (count - 1)) for i in range(count)]


def _overlap(a: Corners, b: Corners) -> float:
    """Of the upright boxes around both, share of the smaller."""
    low, high = np.maximum(a.min(axis=0), b.min(axis=0)), np.minimum(a.max(axis=0), b.max(axis=0))
    common = float(np.prod(np.maximum(high - low, 0.0)))
    return common / max(min(float(np.prod(np.ptp(box, axis=0))) for box in (a, b)), 1.0)
