"""Which wall the camera has seen well enough to read on: looks in, an answer for a point out.

Kept as cells of the map, by the direction in which the wall faces.
"""

from __future__ import annotations

from math import pi

import numpy as np

from common.geometry import Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.placement.wall_line import WallLine, WallPoint

CELL_M = 0.10
SPAN_SHARE = 0.9  # of the picture's width: a plate on its border is cut off
LOOKS = 13  # columns of a picture; less than a cell apart
REACH_M = 1.8  # from further away plates are too small


class ImagedWall:
    """All looks so far."""

    def __init__(self) -> None:
        self._cells: set[tuple[int, int, int]] = set()

    def add(self, pose: Pose2, wall: WallLine, camera: CameraModel) -> None:
        """Takes a look at the wall from a pose."""
        if wall.distance_m > REACH_M:
            return
        half_px = SPAN_SHARE * camera.width_px / 2
        for u_px in camera.width_px / 2 + np.linspace(-half_px, half_px, LOOKS):
            point = wall.point(pose, camera.bearing_rad(float(u_px)))
            if point is not None:
                self._cells.add(_cell(point))

    def holds(self, point: WallPoint) -> bool:
        """Whether a plate there would have been seen, also where the map has moved a little since."""
        x, y, facing = _cell(point)
        return any((x + dx, y + dy, facing) in self._cells for dx in (-1, 0, 1) for dy in (-1, 0, 1))


def _cell(point: WallPoint) -> tuple[int, int, int]:
    return round(point.x_m / CELL_M), round(point.y_m / CELL_M), round(point.normal_rad / (pi / 2)) % 4
