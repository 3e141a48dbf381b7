"""Occupancy grid for driving: wall where echoes agree, free where a range passed, unknown where nothing was measured.

A lost echo is no information, except that nothing stands close in front of a sonar that received no echo several times
in a row. A ray never frees what lies behind a known wall.
"""

from __future__ import annotations

from math import radians, sqrt

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points
from common.grid_cells import FREE, UNKNOWN, WALL

# Sizes of cells, patches and rays. The sensitivity was not measured
CELL_M = 0.1
GROWTH_CELLS = 100
DRAWN_MAX_M = 500.0  # from the map's zero, in x and y: memory follows the floor, not the worst pose
RAY_SPREAD_RAD = tuple(radians(a) for a in (-8.0, -4.0, 0.0, 4.0, 8.0))
RAY_MARGIN_M = 0.15  # a ray ends this far before its echo
RAY_MAX_M = 6.2
SILENT_FREE_M = 1.0  # how far a sonar that receives no echo several times in a row frees
HITS_FOR_WALL = 2
RAYS_AT_ONCE = 100  # a worker's memory: each takes 20 kB while it is drawn
FOOTPRINT_CLEAR_M = 0.25
_STEP_M = 0.08
_PATCH_M = np.array([-sqrt(2.0), 0.0, sqrt(2.0)]) * CELL_M  # never two of them in one cell
_REACHES = np.arange(0.0, RAY_MAX_M, _STEP_M)
_DISC = np.array(
    [
        (x, y)
        for x in np.arange(-0.2, 0.21, 0.1)
        for y in np.arange(-0.2, 0.21, 0.1)
        if x * x + y * y <= FOOTPRINT_CLEAR_M**2
    ]
)

Cells = npt.NDArray[np.uint8]


class OccupancyGrid:
    """Grows as the map does. `cells()` gives the grid; `origin_m` is the outer corner of cell (0, 0)."""

    def __init__(self) -> None:
        self._origin = np.array([-10.0, -10.0])
        self._hits = np.zeros((200, 200), np.uint16)  # [row along y, column along x]
        self._passed = np.zeros((200, 200), np.bool_)
        self._driven = np.zeros((200, 200), np.bool_)

    @property
    def origin_m(self) -> tuple[float, float]:
        return float(self._origin[0]), float(self._origin[1])

    def add_walls(self, points_m: Points, normals_rad: FloatArray) -> None:
        """Echoes (N, 2) and the normals (N,) of their walls: each stands for a patch, since only a surface echoes."""
        if len(points_m):
            along = np.stack([-np.sin(normals_rad), np.cos(normals_rad)], axis=1)
            patches = (points_m[:, None, :] + along[:, None, :] * _PATCH_M[None, :, None]).reshape(-1, 2)
            if not self._make_room(patches):
                patches = patches[_drawn(patches)]
            cell = self._flat(patches[:, 0], patches[:, 1])
            np.add.at(self._hits.ravel(), cell[~self._driven.ravel()[cell]], 1)

    def add_rays(self, starts_m: Points, directions_rad: npt.ArrayLike, free_m: npt.ArrayLike) -> None:
        """Free space along rays: starts (N, 2), directions (N,), how far (N,); infinite where no echo came."""
        directions, lengths = np.asarray(directions_rad), np.asarray(free_m, dtype=np.float64)
        for i in range(0, len(starts_m), RAYS_AT_ONCE):
            part = slice(i, i + RAYS_AT_ONCE)
            self._add_rays(starts_m[part], directions[part], lengths[part])

    def _add_rays(self, starts_m: Points, directions_rad: FloatArray, free: FloatArray) -> None:
        free = np.where(np.isfinite(free), np.minimum(free - RAY_MARGIN_M, RAY_MAX_M), SILENT_FREE_M)
        spread = np.array(RAY_SPREAD_RAD)
        angle = (directions_rad[:, None] + spread[None, :]).ravel()
        free = np.repeat(free, len(spread))
        start = np.repeat(starts_m, len(spread), axis=0)
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = start + unit * np.maximum(free, 0.0)[:, None]
        if not self._make_room(np.concatenate([starts_m, ends])):
            drawn = _drawn(start) & _drawn(ends)
            start, unit, free = start[drawn], unit[drawn], free[drawn]
        steps = int(free.max(initial=0.0) / _STEP_M) + 1
        reach = _REACHES[:steps]
        cell = self._flat(start[:, :1] + unit[:, :1] * reach, start[:, 1:] + unit[:, 1:] * reach)
        wall = self._hits.ravel()[cell] > 0
        before_wall = np.where(wall.any(axis=1), wall.argmax(axis=1), steps)  # so many steps
        open_ = (reach <= free[:, None]) & (np.arange(steps) < before_wall[:, None])
        self._passed.ravel()[cell[open_]] = True

    def add_footprint(self, positions_m: Points) -> None:
        """Where the robot itself stood (N, 2) is free and stays so, whatever the sonars measure: it can drive back.

        In a crossing of narrow halls the echoes of corners, drawn as patches of wall, would close the mouths.
        """
        for i in range(0, len(positions_m), RAYS_AT_ONCE):
            part = positions_m[i : i + RAYS_AT_ONCE]
            if not self._make_room(part):
                part = part[_drawn(part)]
            cell = self._flat(part[:, :1] + _DISC[:, 0], part[:, 1:] + _DISC[:, 1])
            self._passed.ravel()[cell] = self._driven.ravel()[cell] = True
            self._hits.ravel()[cell] = 0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self._hits.shape
        return rows, columns

    def cells(self, first_row: int = 0, end_row: int | None = None) -> Cells:
        """(rows, columns) of UNKNOWN, FREE, WALL: all rows, or some of them."""
        rows = slice(first_row, end_row)
        cells = np.where(self._passed[rows], np.uint8(FREE), np.uint8(UNKNOWN))
        cells[self._hits[rows] >= HITS_FOR_WALL] = WALL
        return cells

    def _flat(self, x_m: FloatArray, y_m: FloatArray) -> npt.NDArray[np.intp]:
        """Cells of places, of any shape, as indices into the flattened grid; beyond its rim that of the rim."""
        rows, columns = self._hits.shape
        # Without `floor`, which differs below zero only: beyond the rim
        column = ((x_m - self._origin[0]) / CELL_M).astype(np.intp)
        row = ((y_m - self._origin[1]) / CELL_M).astype(np.intp)
        row, column = np.minimum(np.maximum(row, 0), rows - 1), np.minimum(np.maximum(column, 0), columns - 1)
        flat: npt.NDArray[np.intp] = row * columns + column
        return flat

    def _make_room(self, points_m: Points) -> bool:
        """Grow where points (N, 2) need it; false where some lie too far off to be drawn."""
        low, high = points_m.min(axis=0) - 1.0, points_m.max(axis=0) + 1.0
        end = self._origin + np.array(self._hits.shape)[::-1] * CELL_M
        if not ((low < self._origin).any() or (high > end).any()):
            return True
        drawn = _drawn(points_m)
        near = points_m[drawn]
        if len(near):
            before = np.ceil((self._origin - near.min(axis=0) + 1.0) / CELL_M).astype(int)
            after = np.ceil((near.max(axis=0) + 1.0 - end) / CELL_M).astype(int)
            before = np.where(before > 0, before + GROWTH_CELLS, 0)
            after = np.where(after > 0, after + GROWTH_CELLS, 0)
            if before.any() or after.any():
                pad = ((before[1], after[1]), (before[0], after[0]))
                self._hits, self._passed = np.pad(self._hits, pad), np.pad(self._passed, pad)
                self._driven = np.pad(self._driven, pad)
                self._origin = self._origin - before * CELL_M
        return bool(drawn.all())


def _drawn(points_m: Points) -> npt.NDArray[np.bool_]:
    """Which of the points (N, 2) are near enough."""
    x_m, y_m = np.abs(points_m).T
    near: npt.NDArray[np.bool_] = np.maximum(x_m, y_m) <= DRAWN_MAX_M
    return near
