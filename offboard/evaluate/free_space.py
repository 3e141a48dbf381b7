"""A floor file as the evaluation sees it: wall samples with normals, and free space in cells of 5 cm.

Only evaluation reads this; it knows the truth and never runs in a robot's process.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points

CELL_M = 0.05
BORDER_M = 0.5
WALL_STEP_M = 0.05
PROBE_M = 0.15  # how far to each side of a wall free space is looked for
RAY_MAX_M = 8.0
SIGHT_SAMPLES = 60
SIGHT_END_M = 0.12  # the end of a line of sight lies on the wall itself

Mask = npt.NDArray[np.bool_]


def _rings(floor: dict[str, Any]) -> list[Points]:
    corridor = floor["corridor"]
    return [np.array(ring, dtype=np.float64) for ring in (corridor["exterior"], *corridor["holes"])]


class FreeSpace:
    """The corridor of a floor as a raster, in the floor's own frame."""

    def __init__(self, floor: dict[str, Any]) -> None:
        rings = _rings(floor)
        self._low = rings[0].min(axis=0) - BORDER_M
        columns, rows = np.ceil((rings[0].max(axis=0) + BORDER_M - self._low) / CELL_M).astype(int) + 1
        free = np.zeros((rows, columns), np.uint8)
        cv2.fillPoly(free, [np.round((ring - self._low) / CELL_M).astype(np.int32) for ring in rings], (1,))
        self._free: Mask = free.astype(bool)
        self._wall_distance_m = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5)) * CELL_M

    def _cells(self, points_m: Points) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Mask]:
        """Row and column of points (..., 2), and whether they lie inside the raster (row and column 0 where not)."""
        cell = np.round((points_m - self._low) / CELL_M).astype(np.int64)
        rows, columns = self._free.shape
        column, row = cell[..., 0], cell[..., 1]
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        return np.where(inside, row, 0), np.where(inside, column, 0), inside

    def is_free(self, points_m: Points) -> Mask:
        """Which of the points (..., 2) lie in the corridor."""
        row, column, inside = self._cells(points_m)
        return inside & self._free[row, column]

    def wall_distance_m(self, points_m: Points) -> FloatArray:
        """Distance of the points (..., 2) to the nearest wall, 0 outside."""
        row, column, inside = self._cells(points_m)
        return np.where(inside, self._wall_distance_m[row, column], 0.0).astype(np.float64)

    def in_sight(self, eye_m: Points, targets_m: Points) -> Mask:
        """Which of the targets (N, 2), which lie on walls, the eye (2,) sees."""
        share = np.linspace(0.0, 1.0, SIGHT_SAMPLES)
        offset = targets_m - eye_m
        samples = eye_m + offset[:, None] * share[None, :, None]
        at_end = (1 - share) * np.hypot(offset[:, 0], offset[:, 1])[:, None] < SIGHT_END_M
        return np.asarray((self.is_free(samples) | at_end).all(axis=1))

    def ray_length_m(self, points_m: Points, angles_rad: FloatArray) -> FloatArray:
        """(N,) how far from the points (N, 2) along the angles (N,) the next wall is, at most RAY_MAX_M."""
        reach_m = np.arange(0.0, RAY_MAX_M, CELL_M)
        direction = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
        blocked = ~self.is_free(points_m[:, None] + reach_m[None, :, None] * direction[:, None])
        return np.where(blocked.any(axis=1), reach_m[blocked.argmax(axis=1)], RAY_MAX_M)


def _edges(floor: dict[str, Any]) -> Iterator[tuple[Points, Points]]:
    for ring in _rings(floor):
        yield from zip(ring, np.roll(ring, -1, axis=0), strict=True)


def wall_samples(floor: dict[str, Any], space: FreeSpace) -> tuple[Points, Points]:
    """Points (N, 2) every WALL_STEP_M along all walls, and their normals (N, 2) into the corridor."""
    points, normals = [], []
    for start, end in _edges(floor):
        length_m = float(np.hypot(*(end - start)))
        if length_m < 1e-6:
            continue
        count = max(int(length_m / WALL_STEP_M), 1)
        on_wall = start + (end - start) * ((np.arange(count) + 0.5) / count)[:, None]
        along = (end - start) / length_m
        normal = np.array([-along[1], along[0]])
        ahead, behind = (space.is_free(on_wall + side * PROBE_M * normal).mean() for side in (1, -1))
        points.append(on_wall)
        normals.append(np.tile(-normal if ahead < behind else normal, (count, 1)))
    return np.concatenate(points), np.concatenate(normals)
