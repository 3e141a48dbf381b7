"""The OCR engine: a picture in, its lines of text out. The only module that knows rapidocr.

Text is looked for in a shrunken copy and read at the picture's own scale. Each line is taken apart into strokes as well
(`letters.py`), because the engine is certain of what it half sees.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import Any

import cv2
import numpy as np

from onboard.poi.camera.frame import Image
from onboard.poi.signs.letters import ROWS, strokes
from onboard.poi.signs.line_check import FLAT, Character, checked
from onboard.poi.signs.text_line import Corners, TextLine, box_of, least_certain

DETECTION_SIDE_PX = 480  # longer side of the image that rapidocr looks for text in
MARGIN = 0.8  # around a line, in heights of its box
ROWS_MAX = 1.5 * ROWS  # of a line that is read; a higher one is shrunk
READ_COLUMNS = 160  # of 48 rows: what short lines are padded to; the engine's own 320 take twice the time for nothing
SURE = 0.9  # confidence below which a line with digits is read twice
WIDER = 0.04  # on each side, in heights of the line with its margin
STEEP = 1.5  # height over width of a box whose text may run up or down
LETTER_MAX = 2.6  # and of one that may hold a single letter
TURNED = frozenset("0168986|HIONSXZ.- ")  # upside down these are letters all the same


class SignReader:
    """rapidocr with its bundled models, one thread, so that it repeats to the bit. Loading takes about a second."""

    def __init__(self, detection_side_px: int = DETECTION_SIDE_PX) -> None:
        from rapidocr import RapidOCR  # here: a process without camera need not have it

        cv2.setNumThreads(1)
        self._side_px = detection_side_px
        self._ocr: Any = RapidOCR(
            params={
                "Global.log_level": "critical",
                "Det.limit_side_len": detection_side_px,
                "Det.limit_type": "max",
                "Rec.rec_img_shape": [3, 48, READ_COLUMNS],
                "EngineConfig.onnxruntime.intra_op_num_threads": 1,
                "EngineConfig.onnxruntime.inter_op_num_threads": 1,
            }
        )

    def lines(self, image: Image) -> list[TextLine]:
        """All text in a picture, with its place in pixels of `image`."""
        return self.read(image, self.boxes(image))

    def boxes(self, image: Image) -> list[Corners]:
        """Where text stands; looked for in a copy that is shrunk to the detection side."""
        scale = min(1.0, self._side_px / max(image.shape[:2]))
        if scale < 1.0:
            image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        found = self._ocr(image, use_det=True, use_cls=False, use_rec=False)
        return [] if found.boxes is None else [np.asarray(box, np.float32) / np.float32(scale) for box in found.boxes]

    def read(self, image: Image, boxes: Sequence[Corners]) -> list[TextLine]:
        """The lines of text in these boxes, at the picture's own scale; those without letters are left out."""
        return [line for box in boxes for line in self._lines_in(image, box)]

    def _lines_in(self, image: Image, box: Corners, whole: bool = True) -> list[TextLine]:
        """One line as a rule; with `whole`, a pictogram beside it and words far apart are each read by themselves."""
        width, height = _size(box)
        turns = ([0] if height < LETTER_MAX * width else []) + ([1, 3] if height >= STEEP * width else [])
        views = []
        for turn in turns:
            corners = np.roll(box, turn, axis=0)
            picture, margin = _level(image, corners)
            characters = self._recognised(picture[margin:-margin, margin:-margin])
            if any(c.text.isdigit() for c in characters) and _confidence(characters) < SURE:
                # The same letters a little smaller often read better
                wider = margin - round(WIDER * picture.shape[0])
                again = self._recognised(picture[wider:-wider, wider:-wider])
                characters = max(characters, again, key=_confidence)
            if characters:
                views.append((_confidence(characters), turn, corners, picture, margin, characters))
        if not views:
            return []
        confidence, turn, corners, picture, margin, characters = max(views, key=lambda view: view[0])
        letters, flat = sum(not c.text.isspace() for c in characters), sum(c.text in FLAT for c in characters)
        check = checked(strokes(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), margin, letters, flat), characters)
        if whole and (check.parts or check.rows != (0.0, 1.0)):
            boxes = [_part(corners, columns, check.rows) for columns in check.parts or ((0.0, 1.0),)]
            return [line for box in boxes for line in self._lines_in(image, box, whole=False)]
        text = "".join(c.text for c in characters)
        damage = check.damage
        if turn and all(c in TURNED for c in text.upper()):
            damage = damage or "may stand upside down"
        strokes_px = check.capital * _size(corners)[1]
        certain = tuple(c.confidence for c in characters if not c.text.isspace())
        return [TextLine(text, confidence, *box_of(corners), strokes_px, damage, certain)]

    def _recognised(self, picture: Image) -> list[Character]:
        picture = np.ascontiguousarray(picture)
        found = self._ocr(picture, use_det=False, use_cls=False, use_rec=True, return_word_box=True)
        if not found.txts or not found.txts[0].strip():
            return []
        text, info = found.txts[0], found.word_results[0]
        confidences = [*info.confs, *[0.0] * len(text)]
        return [Character(c, float(confidences[i])) for i, c in enumerate(text)]


def _confidence(characters: Sequence[Character]) -> float:
    return least_certain("".join(c.text for c in characters), [c.confidence for c in characters])


def _size(corners: Corners) -> tuple[float, float]:
    """Width and height of a box, its longer sides."""
    a, b, c, d = corners
    return max(hypot(*(b - a)), hypot(*(c - d)), 1.0), max(hypot(*(d - a)), hypot(*(c - b)), 1.0)


def _part(corners: Corners, columns: tuple[float, float], rows: tuple[float, float]) -> Corners:
    """The part of a box between two shares of its width, and two of its height."""
    a, b, c, d = corners
    upper, lower = ((a + row * (d - a), b + row * (c - b)) for row in rows)
    (begin, end), ((a, b), (d, c)) = columns, (upper, lower)
    return np.array([a + begin * (b - a), a + end * (b - a), d + end * (c - d), d + begin * (c - d)], np.float32)


def _level(image: Image, corners: Corners) -> tuple[Image, int]:
    """The box of a line as a level picture of at most ROWS_MAX rows, and the margin that it has on each side."""
    width, height = _size(corners)
    scale = min(1.0, ROWS_MAX / height)
    if scale < 1.0:  # a warp alone would skip pixels
        reach = round(2 * MARGIN * height) + 2
        (x0, y0), (x1, y1) = np.floor(corners.min(axis=0)) - reach, np.ceil(corners.max(axis=0)) + reach
        left, top = max(int(x0), 0), max(int(y0), 0)
        part = image[top : int(y1), left : int(x1)]
        image = np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        corners = (corners - np.array([left, top], np.float32)) * np.float32(scale)
        width, height = scale * width, scale * height
    columns, rows, margin = max(round(width), 4), max(round(height), 4), max(round(MARGIN * height), 2)
    right, bottom = margin + columns, margin + rows
    target = np.array([(margin, margin), (right, margin), (right, bottom), (margin, bottom)], np.float32)
    matrix = cv2.getPerspectiveTransform(corners, target)
    size = columns + 2 * margin, rows + 2 * margin
    level = cv2.warpPerspective(image, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(level, np.uint8), margin
