"""Whether a camera's pictures can be worked with: previews in, an error code out. Pure.

A picture that is the same to the bit while the robot moves is no new one: what it shows stands elsewhere by now. It is
left out at once, and reported where it shows something that would have moved. Dark, bright and late pictures are
reported after a while, since a lamp or a busy moment does no harm.
"""

from __future__ import annotations

from collections import deque
from math import inf

import cv2
import numpy as np

from common.errors import ErrorCode
from onboard.poi.camera.frame import PREVIEW_PERIOD_S, Image

NO_FRAMES_S = 2.0  # five previews
BAD_IN_A_ROW = 5  # previews
DARK_MAX = 20  # grey value that hardly anything exceeds; a hall without lamps shows 80
BRIGHT_MIN = 250  # grey value that hardly anything falls below
HARDLY = 5  # percent of a picture
RARE_S = 5 * PREVIEW_PERIOD_S  # between previews, on average over INTERVALS
INTERVALS = 3
RARE_GONE = 3.0  # usual intervals, after which a slow camera is none
MOVED_M = 0.05  # path of the robot in which a new picture differs
STRUCTURE, STRUCTURE_SHARE = 60.0, 0.002  # strong steps along a row, which move with the robot
PLAIN_MAX_M = 5.0  # of path along a wall without any
_SAMPLE = 8  # one of so many rows and columns tells how bright a picture is


class FrameHealth:
    """What the newest previews were like."""

    def __init__(self) -> None:
        self._times_s: deque[float] = deque(maxlen=INTERVALS + 1)
        self._waits_since_s = inf
        self._last: Image | None = None
        self._same_since_m = 0.0
        self._frozen = False
        self._in_a_row: dict[ErrorCode, int] = {ErrorCode.FRAMES_DARK: 0, ErrorCode.FRAMES_BRIGHT: 0}

    def paused(self, now_s: float) -> None:
        """Nobody looks: pictures that are missed meanwhile are not missing."""
        self._times_s.clear()
        self._waits_since_s = now_s

    def takes(self, preview: Image, now_s: float, driven_m: float) -> bool:
        """Takes a preview in; whether it is a new one, that may be looked at."""
        self._times_s.append(now_s)
        self._waits_since_s = now_s
        gray = cv2.cvtColor(preview[::_SAMPLE, ::_SAMPLE], cv2.COLOR_BGR2GRAY)
        low, high = np.percentile(gray, (HARDLY, 100 - HARDLY))
        for code, is_so in ((ErrorCode.FRAMES_DARK, high < DARK_MAX), (ErrorCode.FRAMES_BRIGHT, low > BRIGHT_MIN)):
            self._in_a_row[code] = self._in_a_row[code] + 1 if is_so else 0
        if self._last is None or not np.array_equal(self._last, preview):
            self._last, self._same_since_m, self._frozen = preview, driven_m, False
            return True
        moved_m = driven_m - self._same_since_m
        self._frozen = moved_m > PLAIN_MAX_M or (moved_m > MOVED_M and _has_structure(preview))
        return moved_m <= MOVED_M

    def fault(self, now_s: float) -> ErrorCode:
        """What is wrong with the camera now; OK where nothing is."""
        self._waits_since_s = min(self._waits_since_s, now_s)
        waits_s = now_s - self._waits_since_s
        usual_s = (self._times_s[-1] - self._times_s[0]) / (len(self._times_s) - 1) if len(self._times_s) > 1 else 0.0
        if usual_s > RARE_S and waits_s < RARE_GONE * usual_s:
            return ErrorCode.FRAMES_RARE
        if waits_s > NO_FRAMES_S:
            return ErrorCode.NO_FRAMES
        if self._frozen:
            return ErrorCode.FRAMES_FROZEN
        return next((code for code, count in self._in_a_row.items() if count >= BAD_IN_A_ROW), ErrorCode.OK)


def _has_structure(preview: Image) -> bool:
    gray = cv2.cvtColor(preview, cv2.COLOR_BGR2GRAY)
    steps = np.abs(cv2.Sobel(gray, cv2.CV_16S, 1, 0)) > STRUCTURE
    return bool(steps.mean() > STRUCTURE_SHARE)
