"""The occupancy grid as the Planner reads it: clearance from walls, where the footprint can stand, and the frontier."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot
from typing import Any

import numpy as np
import numpy.typing as npt

from common.constants import FOOTPRINT_RADIUS_M, PLANNER_CLEARANCE_M
from common.geometry import FloatArray, Points
from common.grid_cells import FREE, UNKNOWN, WALL

CLEARANCE_MAX_CELLS = 16
LINE_STEPS_MAX = 20_000  # over a kilometre; from one end of any floor to the other
STAND_CLEARANCE_M = FOOTPRINT_RADIUS_M + PLANNER_CLEARANCE_M - 0.04  # the wall cell's own half width is part of it
OPENING_CLEARANCE_M = STAND_CLEARANCE_M  # a frontier nearer to a wall is a gap in its echoes, not an opening
SLIVER_PASSES = 4  # closes holes of up to 0.7 m between rays
FRONTIER_NEIGHBOURS_MIN = 4  # frontier cells within 0.2 m, itself included

Mask = npt.NDArray[np.bool_]
SquaredDistances = npt.NDArray[np.int16]
Cell = tuple[int, int]  # row, column


@dataclass(frozen=True)
class GridMap:
    """`cells` (rows, columns) of UNKNOWN, FREE, WALL, or kept out by zones, which is above all of them;
    `origin` is the outer corner of cell (0, 0) in the map."""

    cells: npt.NDArray[np.uint8]
    origin_x_m: float
    origin_y_m: float
    cell_m: float

    def cell(self, x_m: float, y_m: float) -> Cell:
        """The cell at a position in the map; it may lie outside the grid (`contains`)."""
        return int((y_m - self.origin_y_m) // self.cell_m), int((x_m - self.origin_x_m) // self.cell_m)

    def centre(self, cell: Cell) -> tuple[float, float]:
        return self.origin_x_m + (cell[1] + 0.5) * self.cell_m, self.origin_y_m + (cell[0] + 0.5) * self.cell_m

    def centres(self, cells: npt.NDArray[np.int64]) -> Points:
        """Map positions (N, 2) of cells (N, 2)."""
        centres: Points = (cells[:, ::-1] + 0.5) * self.cell_m + np.array([self.origin_x_m, self.origin_y_m])
        return centres

    def contains(self, cell: Cell) -> bool:
        return bool(0 <= cell[0] < self.cells.shape[0] and 0 <= cell[1] < self.cells.shape[1])

    def around(self, x_m: float, y_m: float, reach: int) -> set[Cell]:
        """The cell of a position and those up to `reach` cells away from it along both axes."""
        row, column = self.cell(x_m, y_m)
        span = range(-reach, reach + 1)
        return {(row + i, column + j) for i in span for j in span}

    def stands(self, x_m: float, y_m: float) -> bool:
        """May the footprint stand at that position?"""
        cell = self.cell(x_m, y_m)
        return self.contains(cell) and bool(self.standable(cell))

    def cells_of(self, points: Points) -> npt.NDArray[np.int64]:
        """The cells (N, 2) at positions (N, 2) in the map; they may lie outside the grid."""
        offset = points - np.array([self.origin_x_m, self.origin_y_m])
        cells: npt.NDArray[np.int64] = (offset[:, ::-1] // self.cell_m).astype(np.int64)
        return cells

    def stands_each(self, points: Points) -> Mask:
        """May the footprint stand there (N,), at positions (N, 2)?"""
        cells = self.cells_of(points)
        stands = np.asarray(((cells >= 0) & (cells < np.array(self.cells.shape))).all(axis=1))
        stands[stands] = self.standable(tuple(cells[stands].T))
        return stands

    def window(self, x_m: float, y_m: float, reach_m: float) -> GridMap:
        """The part of the grid up to `reach_m` from a position along both axes."""
        reach = round(reach_m / self.cell_m)
        row, column = self.cell(x_m, y_m)
        r0, c0 = max(row - reach, 0), max(column - reach, 0)
        return self.part((slice(r0, max(row + reach + 1, 0)), slice(c0, max(column + reach + 1, 0))))

    def part(self, rows_columns: tuple[slice, slice]) -> GridMap:
        """A part of the grid as one of its own."""
        rows, columns = rows_columns
        origin_x_m, origin_y_m = (
            self.origin_x_m + columns.start * self.cell_m,
            self.origin_y_m + rows.start * self.cell_m,
        )
        return GridMap(self.cells[rows_columns], origin_x_m, origin_y_m, self.cell_m)

    @cached_property
    def wall_distance2(self) -> SquaredDistances:
        """(rows, columns) to the nearest cell that is a wall or kept out, in cells, squared; at most
        CLEARANCE_MAX_CELLS far."""
        return _squared_distance(self.cells >= WALL, CLEARANCE_MAX_CELLS)

    @cached_property
    def clearances_m(self) -> npt.NDArray[np.float32]:
        """Metres (CLEARANCE_MAX_CELLS squared + 1,) for every value of `wall_distance2`."""
        squared = np.arange(CLEARANCE_MAX_CELLS**2 + 1, dtype=np.int16)
        return np.sqrt(squared, dtype=np.float32) * np.float32(self.cell_m)

    def clearance_m(self, index: Any = ...) -> npt.NDArray[np.float32]:
        """From the centres of cells to the nearest wall cell's; `index` into (rows, columns), all where not given."""
        clearance: npt.NDArray[np.float32] = self.clearances_m[self.wall_distance2[index]]
        return clearance

    def standable(self, index: Any = ...) -> Mask:
        """Free cells on which the footprint keeps its distance from every known wall; `index` as of `clearance_m`."""
        mask: Mask = (self.cells[index] == FREE) & (self.clearance_m(index) >= STAND_CLEARANCE_M)
        return mask

    @cached_property
    def frontier(self) -> Mask:
        """(rows, columns) free cells beside unknown ones, both away from walls, and not alone: where the robot could
        go on, and nobody has looked."""
        unknown = (self.cells == UNKNOWN) & (self.clearance_m() >= STAND_CLEARANCE_M)
        beside = np.zeros_like(unknown)
        beside[1:] |= unknown[:-1]
        beside[:-1] |= unknown[1:]
        beside[:, 1:] |= unknown[:, :-1]
        beside[:, :-1] |= unknown[:, 1:]
        candidates = (self.cells == FREE) & beside & (self.clearance_m() >= OPENING_CLEARANCE_M)
        count = _box_sum(candidates, 2)
        mask: Mask = candidates & (count >= FRONTIER_NEIGHBOURS_MIN)
        return mask

    @cached_property
    def area_m2(self) -> float:
        """Of the free cells."""
        return float((self.cells == FREE).sum()) * self.cell_m**2

    def line(self, a: tuple[float, float], b: tuple[float, float]) -> tuple[npt.NDArray[np.int64], ...]:
        """Rows and columns of the cells from position a to position b, clipped to the grid."""
        steps = min(max(int(hypot(b[0] - a[0], b[1] - a[1]) / (0.6 * self.cell_m)), 1), LINE_STEPS_MAX)
        f = np.arange(steps + 1) / steps
        return self._clipped(a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]))

    def _clipped(self, x_m: FloatArray, y_m: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Rows and columns of the cells at positions of any shape, or of those at the border beside them."""
        columns = ((x_m - self.origin_x_m) / self.cell_m).astype(np.int64)
        rows = ((y_m - self.origin_y_m) / self.cell_m).astype(np.int64)
        for cells, count in ((rows, self.cells.shape[0]), (columns, self.cells.shape[1])):
            np.maximum(cells, 0, out=cells)
            np.minimum(cells, count - 1, out=cells)
        return rows, columns

    def sees(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """No wall, and nothing that is kept out, between two positions."""
        return not bool((self.cells[self.line(a, b)] >= WALL).any())

    def sees_each(self, a: Points, b: Points) -> Mask:
        """Of each pair of positions a and b (N, 2), or (2,) for all of them: no wall between (N,)."""
        a, b = np.atleast_2d(a), np.atleast_2d(b)
        d = b - a
        steps = np.clip(np.hypot(d[:, 0], d[:, 1]) / (0.6 * self.cell_m), 1, LINE_STEPS_MAX).astype(np.int64)
        f = np.minimum(np.arange(int(steps.max(initial=1)) + 1) / steps[:, None], 1.0)
        lines = self._clipped(a[:, :1] + f * d[:, :1], a[:, 1:] + f * d[:, 1:])
        free: Mask = (self.cells[lines] != WALL).all(axis=1)
        return free


def close_slivers(cells: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Unknown cells almost surrounded by free ones are free: gaps between neighbouring rays."""
    out = cells.copy()
    for _ in range(SLIVER_PASSES):
        free = _box_sum(out == FREE, 1)
        out[(out == UNKNOWN) & (free >= 5)] = FREE
    return out


def _box_sum(mask: Mask, reach: int) -> npt.NDArray[np.uint8]:
    """How many cells (rows, columns) up to `reach` away, itself included, are in the mask."""
    rows, columns = mask.shape
    padded = np.pad(mask.view(np.uint8), reach)
    across = padded[:, :columns].copy()
    for j in range(1, 2 * reach + 1):
        across += padded[:, j : j + columns]
    total = across[:rows].copy()
    for i in range(1, 2 * reach + 1):
        total += across[i : i + rows]
    return total


def _squared_distance(walls: Mask, reach: int) -> SquaredDistances:
    """Exact Euclidean distance to the nearest wall in cells, at most `reach`, squared (separable, in two passes)."""
    rows, columns = walls.shape
    far = columns + reach
    index = np.arange(columns, dtype=np.int32)
    left = np.maximum.accumulate(np.where(walls, index, -far), axis=1)
    right = np.minimum.accumulate(np.where(walls, index, far + columns)[:, ::-1], axis=1)[:, ::-1]
    along = np.minimum(np.minimum(index - left, right - index), reach).astype(np.int16)
    squared = np.pad(along * along, ((reach, reach), (0, 0)), constant_values=reach * reach)
    best = squared[reach : reach + rows].copy()
    for k in range(1, reach + 1):
        for offset in (reach - k, reach + k):
            np.minimum(best, squared[offset : offset + rows] + np.int16(k * k), out=best)
    return np.minimum(best, np.int16(reach * reach))
