"""Handles of doors in a preview: small things that lie level at the height of a hand. Pure.

A lever is wider than high and stands out from what is above and below it, whatever its colour; upright lines are taken
out by what they share with their neighbours above and below.
"""

from __future__ import annotations

import cv2
import numpy as np

from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Gray

LOW_M, HIGH_M = 0.94, 1.16  # above the floor
REACH_M = 0.09  # above and below: nothing higher than this is a handle
WIDTH_M, HEIGHT_M = (0.06, 0.20), (0.012, 0.085)
STEP = 9.0  # grey values, from what is above and below
NOISES = 5.0


def handle_columns(gray: Gray, camera: CameraModel, depth_m: float) -> list[float]:
    """The middle columns of what may be a handle, from left to right; `depth_m` to the wall."""
    m_per_px = camera.metres_per_px(depth_m)
    top, bottom = (
        int(np.clip(camera.row_px(z, depth_m), 0, camera.height_px)) for z in (HIGH_M + REACH_M, LOW_M - REACH_M)
    )
    if (bottom - top) * m_per_px < 2 * REACH_M:
        return []
    strip = cv2.GaussianBlur(gray[top:bottom], (0, 0), 1.0)
    kernel = np.ones((max(round(REACH_M / m_per_px), 3), 1), np.uint8)
    stands_out = np.maximum(
        cv2.morphologyEx(strip, cv2.MORPH_TOPHAT, kernel), cv2.morphologyEx(strip, cv2.MORPH_BLACKHAT, kernel)
    )
    least = max(STEP, NOISES * float(np.median(stands_out)))
    count, _, stats, _ = cv2.connectedComponentsWithStats((stands_out > least).astype(np.uint8), connectivity=8)
    found = []
    for x, y, width, height, _ in stats[1:count].tolist():
        middle_m = camera.height_m(top + y + height / 2, depth_m)
        sized = WIDTH_M[0] <= width * m_per_px <= WIDTH_M[1] and HEIGHT_M[0] <= height * m_per_px <= HEIGHT_M[1]
        inside = x > 1 and x + width < gray.shape[1] - 1 and y > 0 and y + height < strip.shape[0]
        if sized and inside and LOW_M <= middle_m <= HIGH_M:
            found.append(x + width / 2)
    return sorted(found)
