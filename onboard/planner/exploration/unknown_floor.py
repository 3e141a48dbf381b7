"""How much floor that nobody has seen lies beyond a frontier: what no sonar can ever show is not worth a visit.

The far corner of a room answers no sonar, nor does a niche that the footprint does not fit into: their unknown cells
lie behind corners that were closed (`corner_closing`), or too near to walls to stand on. A place behind a frontier
counts only where the footprint could stand, as far as anybody knows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.geometry import Points
from common.grid_cells import UNKNOWN
from onboard.planner.exploration.corner_closing import Cells, closed_corners
from onboard.planner.grid.grid_map import STAND_CLEARANCE_M, Cell, GridMap, Mask
from onboard.planner.grid.recent import RecentResults

AROUND_CELLS = 36  # of a frontier: as far as what closes corners reaches
CELL_M = 0.1  # of the mapping unit's grid
ENOUGH_CELLS = round(1.2 / CELL_M**2)  # of unknown floor: more is not looked for
ALONG = 0.94  # cosine of the angle to an axis, up to which it drives along it: so far aside a wall echoes
_NEAR = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


class UnknownFloor:
    """Of a grid, with the robot's trail (N, 2); `recent` has what was found on the grids before."""

    def __init__(self, grid: GridMap, trail: Points, recent: RecentResults | None = None) -> None:
        self._grid, self._trail = grid, grid.cells_of(trail)
        self._drives = [np.abs(_directions(trail)[:, axis]) > ALONG for axis in (0, 1)]
        self._recent = recent or RecentResults()

    def beyond_m2(self, frontier: npt.NDArray[np.int64]) -> float:
        """Square metres beyond these cells (N, 2), connected with them; at most those of ENOUGH_CELLS."""
        low = np.maximum(frontier.min(axis=0) - AROUND_CELLS, 0)
        high = np.minimum(frontier.max(axis=0) + AROUND_CELLS + 1, self._grid.cells.shape)
        (r0, c0), (r1, c1) = low.tolist(), high.tolist()
        window = np.s_[r0:r1, c0:c1]
        driven = np.zeros((2, r1 - r0, c1 - c0), dtype=bool)
        for mask, drives in zip(driven, self._drives, strict=True):
            _mark(mask, self._trail[drives] - low)
        roomy = self._grid.clearance_m(window) >= STAND_CLEARANCE_M
        cells = self._recent.of(_cells_beyond, frontier - low, self._grid.cells[window], roomy, driven)
        return min(cells, ENOUGH_CELLS) * self._grid.cell_m**2


def _cells_beyond(frontier: npt.NDArray[np.int64], cells: Cells, roomy: Mask, driven: Mask) -> int:
    """How many cells of unknown floor (rows, columns) hang together with these (N, 2); ENOUGH_CELLS are enough.

    `roomy`: those away from known walls; `driven` (2, rows, columns): where the robot drove along either axis."""
    unknown = _unknown(cells, roomy, driven)
    found: set[Cell] = set()
    stack: list[Cell] = [(r, c) for r, c in frontier.tolist()]
    while stack and len(found) < ENOUGH_CELLS:
        r, c = stack.pop()
        for near in ((r + i, c + j) for i, j in _NEAR):
            inside = 0 <= near[0] < unknown.shape[0] and 0 <= near[1] < unknown.shape[1]
            if inside and near not in found and unknown[near]:
                found.add(near)
                stack.append(near)
    return len(found)


def _unknown(cells: Cells, roomy: Mask, driven: Mask) -> Mask:
    """Where the footprint could stand, though nobody has seen the floor."""
    near_wall = np.zeros(cells.shape, dtype=bool)
    walls = np.argwhere(closed_corners(cells, *driven))
    _mark(near_wall, (walls[:, None] + _DISC).reshape(-1, 2))
    unknown: Mask = (cells == UNKNOWN) & roomy & ~near_wall
    return unknown


def _directions(trail: Points) -> Points:
    """Unit vectors (N, 2) of the way at each point of the trail, from the one before to the one after it."""
    if len(trail) < 2:
        return np.zeros_like(trail)
    ways = np.gradient(trail, axis=0)
    directions: Points = ways / np.maximum(np.hypot(ways[:, 0], ways[:, 1]), 1e-9)[:, None]
    return directions


def _mark(mask: Mask, cells: npt.NDArray[np.int64]) -> None:
    """Those of the cells (N, 2) that lie in it."""
    inside = ((cells >= 0) & (cells < np.array(mask.shape))).all(axis=1)
    mask[tuple(cells[inside].T)] = True


def _disc(radius: float) -> npt.NDArray[np.int64]:
    """Offsets (K, 2) of the cells less than so many cells away."""
    reach = int(radius)
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    offsets: npt.NDArray[np.int64] = np.stack([i, j], axis=-1)[np.hypot(i, j) < radius]
    return offsets


_DISC = _disc(STAND_CLEARANCE_M / CELL_M)
