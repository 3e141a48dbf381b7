"""The small map: walls, trail and robot as coloured half blocks. Pure.

Every character cell shows two squares, one above the other, so that a square of the floor stays a square.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np
import numpy.typing as npt

from offboard.command_center.snapshot import FloorPicture

# Later ones are drawn over earlier ones
EMPTY, PATH, TRAIL, INFERRED, WALL, ZONE = range(6)
ARROWS = "→↗↑↖←↙↓↘"
MIN_SQUARE_M = 0.1
MARGIN_M = 0.5
_POINTS_AT_ONCE = 50_000  # so that a large map takes no more memory than a small one

Codes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Raster:
    """`codes` (2 * rows, columns), top row first; signs that stand instead of a character cell, by (row, column)."""

    codes: Codes
    square_m: float
    findings: frozenset[tuple[int, int]]
    robot: tuple[int, int] | None
    arrow: str

    @property
    def rows(self) -> int:
        return len(self.codes) // 2


def draw(picture: FloorPicture, columns: int, rows: int) -> Raster:
    """The floor as large as it fits into so many character cells, y up."""
    codes = np.zeros((2 * rows, columns), np.uint8)
    pose = picture.pose
    robot_m = np.array([[pose.x_m, pose.y_m]] if pose is not None else []).reshape(-1, 2)
    known = [part for part in (picture.walls_m, picture.trail_m, picture.path_m, robot_m) if len(part)]
    if not known:
        return Raster(codes, MIN_SQUARE_M, frozenset(), None, "")
    low = np.min([part.min(axis=0) for part in known], axis=0).astype(np.float64) - MARGIN_M
    high = np.max([part.max(axis=0) for part in known], axis=0).astype(np.float64) + MARGIN_M
    square_m = float(max(MIN_SQUARE_M, (high[0] - low[0]) / columns, (high[1] - low[1]) / (2 * rows)))
    origin = (low + high) / 2 - square_m * np.array([columns, 2 * rows]) / 2

    def squares(positions: npt.NDArray[np.floating]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        scaled = np.floor((positions.reshape(-1, 2) - origin) / square_m).astype(np.int64)
        inside = (scaled >= 0).all(axis=1) & (scaled < [columns, 2 * rows]).all(axis=1)
        scaled = scaled[inside]
        return 2 * rows - 1 - scaled[:, 1], scaled[:, 0]

    codes[squares(_densified(picture.path_m, pose, square_m))] = PATH
    codes[squares(picture.trail_m)] = TRAIL
    for inferred, code in ((True, INFERRED), (False, WALL)):
        for start in range(0, len(picture.walls_m), _POINTS_AT_ONCE):
            part = slice(start, start + _POINTS_AT_ONCE)
            codes[squares(picture.walls_m[part][(picture.inferred[part] != 0) == inferred])] = code
    for zone in picture.zones:
        corners_m = np.array([zone.sides[0][0], *(end for _, end in zone.sides)], np.float32)
        codes[squares(_densified(corners_m, None, square_m))] = ZONE
    found = squares(np.array([[f.x_m, f.y_m] for f in picture.findings], dtype=np.float64))
    findings = frozenset(zip((found[0] // 2).tolist(), found[1].tolist(), strict=True))
    robot, arrow = None, ""
    if pose is not None:
        row, column = squares(robot_m)
        if len(row):
            robot = (int(row[0]) // 2, int(column[0]))
        arrow = ARROWS[round(pose.heading_rad / (pi / 4)) % 8]
    return Raster(codes, square_m, findings, robot, arrow)


def _densified(path_m: npt.NDArray[np.float32], pose: object, square_m: float) -> npt.NDArray[np.float64]:
    """Points along the way so near to each other that they leave no gap."""
    corners = path_m.reshape(-1, 2).astype(np.float64)
    x_m, y_m = getattr(pose, "x_m", None), getattr(pose, "y_m", None)
    if x_m is not None and y_m is not None and len(corners):
        corners = np.concatenate([[[x_m, y_m]], corners])
    pieces = [np.linspace(a, b, 2 + int(np.hypot(*(b - a)) / square_m)) for a, b in pairwise(corners)]
    return np.concatenate(pieces) if pieces else corners
