"""The OCR engine: a picture in, its lines of text out. The only module that knows rapidocr."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from onboard.poi.camera.frame import Image
from onboard.poi.signs.grouping import merged_lines
from onboard.poi.signs.text_line import TextLine

DETECTION_SIDE_PX = 480  # longer side of the image that rapidocr looks for text in


class SignReader:
    """rapidocr with its bundled models, one thread, so that it repeats to the bit. Loading takes about a second."""

    def __init__(self, detection_side_px: int = DETECTION_SIDE_PX) -> None:
        from rapidocr import RapidOCR  # here: a process without camera need not have it

        cv2.setNumThreads(1)
        self._ocr: Any = RapidOCR(
            params={
                "Global.log_level": "critical",
                "Det.limit_side_len": detection_side_px,
                "Det.limit_type": "max",
                "EngineConfig.onnxruntime.intra_op_num_threads": 1,
                "EngineConfig.onnxruntime.inter_op_num_threads": 1,
            }
        )

    def lines(self, image: Image) -> list[TextLine]:
        """All text in a picture, boxes on one line merged, from top to bottom; places in pixels of `image`."""
        result = self._ocr(image, use_cls=False)
        if result.txts is None:
            return []
        lines = []
        for text, score, corners in zip(result.txts, result.scores, result.boxes, strict=True):
            (x0, y0), (x1, y1) = np.min(corners, axis=0), np.max(corners, axis=0)
            lines.append(TextLine(text.strip(), float(score), float(x0), float(y0), float(x1 - x0), float(y1 - y0)))
        return merged_lines(lines)
