"""Paths over the known floor: Dijkstra's shortest paths that prefer the middle of a hall, and string pulling."""

from __future__ import annotations

import heapq
from array import array
from collections.abc import Collection
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from common.constants import FOOTPRINT_RADIUS_M
from common.geometry import Pose2
from common.grid_cells import FREE
from onboard.planner.grid.grid_map import CLEARANCE_MAX_CELLS, STAND_CLEARANCE_M, Cell, GridMap, Mask

# Nearer to a wall than this a path costs more: it keeps the middle, where a hall is narrower than twice that
COMFORT_M = 1.4
COMFORT_WEIGHT = 1.2  # so much dearer beside a wall: a narrow hall is no reason for a long way round
EDGE_M, EDGE_WEIGHT = 0.55, 6.0  # an edge so near ahead stops the robot
TIGHT_CLEARANCE_M = FOOTPRINT_RADIUS_M + 0.04
TIGHT_PRICE = 12.0
STRING_SHARE = 1.03  # of the path's cost that a straight leg may have
START_RADIUS_CELLS = 4  # around the robot every free cell may be stood on: it stands there

_BEGINNING = 32_767  # no step, for the cell where a search begins
_IMPASSABLE, _TIGHT = 0, CLEARANCE_MAX_CELLS**2 + 1  # kinds of cells; all others are squared distances to a wall

CellPath = npt.NDArray[np.int64]  # (N, 2) neighbouring cells: row, column


@dataclass(frozen=True, slots=True)
class Prices:
    """`kinds` (rows + 2, columns + 2) of cells, with a border that nobody enters, and by kind the price of a step of
    one cell: its metres, dear where the footprint hardly fits; 0 where it does not."""

    kinds: npt.NDArray[np.int16]
    by_kind: list[float]

    def of(self, cell: Cell) -> float:
        return self.by_kind[int(self.kinds[cell[0] + 1, cell[1] + 1])]


def cheapest_path(
    grid: GridMap, pose: Pose2, wanted: Collection[Cell], blocked: Mask
) -> list[tuple[float, float]] | None:
    """Waypoints (map, metres) from a pose to the cheapest of the wanted cells; None where no path leads there."""
    start = grid.cell(pose.x_m, pose.y_m)
    if not grid.contains(start):
        return None
    prices = cell_prices(grid, start, blocked)
    path = shortest_path(prices, start, wanted)
    return None if path is None else pull_string(grid, path, prices)


def cell_prices(grid: GridMap, start: Cell, blocked: Mask | None = None) -> Prices:
    """What a step onto each cell costs a robot that stands on `start`."""
    clearance = grid.clearances_m
    price = 1.0 + COMFORT_WEIGHT * np.maximum(COMFORT_M - clearance, 0.0) / COMFORT_M
    price += EDGE_WEIGHT * np.maximum(EDGE_M - clearance, 0.0) / EDGE_M
    price = np.where(clearance >= STAND_CLEARANCE_M, price, TIGHT_PRICE)
    price = np.append(np.where(clearance >= TIGHT_CLEARANCE_M, price, 0.0), np.float32(TIGHT_PRICE))
    by_kind: list[float] = (price * grid.cell_m).tolist()
    bordered = np.zeros((grid.cells.shape[0] + 2, grid.cells.shape[1] + 2), np.int16)
    kinds = bordered[1:-1, 1:-1]
    np.multiply(grid.wall_distance2, grid.cells == FREE, out=kinds)
    if blocked is not None:
        kinds[blocked] = _IMPASSABLE
    r0, c0 = max(start[0] - START_RADIUS_CELLS, 0), max(start[1] - START_RADIUS_CELLS, 0)
    near = np.s_[r0 : max(start[0] + START_RADIUS_CELLS + 1, 0), c0 : max(start[1] + START_RADIUS_CELLS + 1, 0)]
    here = (grid.cells[near] == FREE) & (price[kinds[near]] == 0.0)
    if blocked is not None and grid.contains(start) and not blocked[start]:
        here &= ~blocked[near]
    kinds[near] = np.where(here, _TIGHT, kinds[near])
    return Prices(bordered, by_kind)


def shortest_path(prices: Prices, start: Cell, wanted: Collection[Cell]) -> CellPath | None:
    """From `start` to the cheapest of the wanted cells, or None where none can be reached (Dijkstra 1959).

    A diagonal step costs the square root of two times as much.
    """
    rows, columns = (side - 2 for side in prices.kinds.shape)
    if not (0 <= start[0] < rows and 0 <= start[1] < columns):
        return None
    width = columns + 2
    kinds = prices.kinds.ravel().data
    best: Any = np.zeros(len(kinds)).data  # of where it came; a page that is not touched takes no memory
    back: Any = np.zeros(len(kinds), np.int16).data
    price_of = prices.by_kind
    steps = [(i * width + j, sqrt(i * i + j * j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    goals = {(row + 1) * width + column + 1 for row, column in wanted}
    first = (start[0] + 1) * width + start[1] + 1
    back[first] = _BEGINNING
    queue: list[tuple[float, int]] = [(0.0, first)]
    pop, push = heapq.heappop, heapq.heappush
    while queue:
        cost, cell = pop(queue)
        if cost > best[cell]:
            continue
        if cell in goals:
            return _traced(back, cell, width)
        for step, length in steps:
            near = cell + step
            price = price_of[kinds[near]]
            if price:
                total = cost + price * length
                if not back[near] or total < best[near]:
                    best[near] = total
                    back[near] = step
                    push(queue, (total, near))
    return None


def _traced(back: memoryview, cell: int, width: int) -> CellPath:
    """Cells from where the search began: `back` holds the step that led to each."""
    cells = array("q", [cell])
    while (step := back[cell]) != _BEGINNING:
        cell -= step
        cells.append(cell)
    rows, columns = np.divmod(np.frombuffer(cells, np.int64)[::-1], width)
    return np.stack([rows, columns], axis=1) - 1


def pull_string(grid: GridMap, path: CellPath, prices: Prices) -> list[tuple[float, float]]:
    """Waypoints (map, metres): as few straight legs as cost no more than the path itself, so they keep its distance
    from walls."""
    by_kind = np.array(prices.by_kind)
    clearance = grid.clearance_m((path[:, 0], path[:, 1]))
    step = np.hypot(*np.diff(path, axis=0, prepend=path[:1]).T)
    spent = np.cumsum(by_kind[prices.kinds[path[:, 0] + 1, path[:, 1] + 1]] * step)
    waypoints = [_centre(grid, path, 0)]
    at = 0
    while at < len(path) - 1:
        reach = at + 1
        step_cells = 1
        while at + step_cells < len(path):
            end = at + step_cells
            a, b = waypoints[-1], _centre(grid, path, end)
            rows, columns = grid.line(a, b)
            price = by_kind[prices.kinds[rows + 1, columns + 1]]
            cells = hypot(b[0] - a[0], b[1] - a[1]) / grid.cell_m
            least_m = min(float(clearance[at : end + 1].min()), STAND_CLEARANCE_M) - 0.5 * grid.cell_m
            clear = bool((price > 0.0).all()) and float(grid.clearance_m((rows, columns)).min()) >= least_m
            if not clear or float(price.mean()) * cells > STRING_SHARE * (spent[end] - spent[at]):
                break
            reach = end
            step_cells += max(1, step_cells // 3)
        waypoints.append(_centre(grid, path, reach))
        at = reach
    return waypoints


def _centre(grid: GridMap, path: CellPath, i: int) -> tuple[float, float]:
    row, column = path[i].tolist()
    return grid.centre((row, column))


def straight_is_clear(
    grid: GridMap, a: tuple[float, float], b: tuple[float, float], clearance_m: float, blocked: Mask | None = None
) -> bool:
    """Only free cells with that clearance, none of them blocked, between two positions."""
    line = grid.line(a, b)
    clear = (grid.clearance_m(line) >= clearance_m) & (grid.cells[line] == FREE)
    if blocked is not None:
        clear &= ~blocked[line]
    return bool(clear.all())
