"""Which wall the camera has seen well enough to read on: looks in, an answer for a point out.

Kept as cells of the map, by the direction in which the wall faces.
"""

from __future__ import annotations

from math import pi

import numpy as np

from common.geometry import FloatArray, Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.placement.map_shift import MapShift
from onboard.poi.placement.wall_line import WallLine, WallPoint

CELL_M = 0.10
SPAN_SHARE = 0.9  # of the picture's width: a plate on its border is cut off
LOOKS = 13  # columns of a picture; less than a cell apart
REACH_M = 1.8  # from further away plates are too small
_CELL = np.array([CELL_M, CELL_M, pi / 2])  # along x, along y, by direction


class ImagedWall:
    """All looks so far."""

    def __init__(self) -> None:
        # By cell the newest look there: x, y, direction, time
        self._cells: dict[tuple[int, int, int], tuple[float, float, float, float]] = {}

    def add(self, pose: Pose2, wall: WallLine, camera: CameraModel, now_s: float) -> None:
        """Takes a look at the wall from a pose."""
        if wall.distance_m > REACH_M:
            return
        half_px = SPAN_SHARE * camera.width_px / 2
        columns_px = camera.width_px / 2 + np.linspace(-half_px, half_px, LOOKS)
        points = [wall.point(pose, camera.bearing_rad(u_px)) for u_px in columns_px.tolist()]
        self._keep(np.array([(p.x_m, p.y_m, p.normal_rad, now_s) for p in points if p is not None]).reshape(-1, 4))

    def move(self, shift: MapShift) -> None:
        """Moves all that was looked at with the map."""
        looks = np.array(list(self._cells.values())).reshape(-1, 4)
        looks[:, :3] = shift.moved(looks[:, :3], looks[:, 3])
        self._cells.clear()
        self._keep(looks)

    def holds(self, point: WallPoint) -> bool:
        """Whether a plate there would have been seen, also where it is a little aside."""
        ((x, y, facing),) = _cells(np.array([[point.x_m, point.y_m, point.normal_rad]]))
        return any((x + dx, y + dy, facing) in self._cells for dx in (-1, 0, 1) for dy in (-1, 0, 1))

    def _keep(self, looks: FloatArray) -> None:
        self._cells.update(zip(_cells(looks[:, :3]), map(tuple, looks.tolist()), strict=True))


def _cells(places: FloatArray) -> list[tuple[int, int, int]]:
    """Of places (N, 3): x, y, direction."""
    cells = np.round(places / _CELL).astype(np.int64)
    cells[:, 2] %= 4
    return [(x, y, facing) for x, y, facing in cells.tolist()]
