"""Ways over the known floor: Dijkstra's shortest paths that like the middle of a hall, and string pulling."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from math import sqrt

import numpy as np

from common.constants import FOOTPRINT_RADIUS_M
from common.geometry import Pose2
from onboard.planner.grid_map import FREE, STAND_CLEARANCE_M, Cell, GridMap, Mask

COMFORT_M = 0.8  # nearer to a wall than this a way costs more
COMFORT_WEIGHT = 3.0
TIGHT_CLEARANCE_M = FOOTPRINT_RADIUS_M + 0.04
TIGHT_PRICE = 12.0
START_RADIUS_CELLS = 4  # around the robot every free cell may be stood on: it stands there
_NEIGHBOURS = [(i, j, sqrt(i * i + j * j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


def cheapest_way(grid: GridMap, pose: Pose2, wanted: set[Cell], blocked: Mask) -> list[tuple[float, float]] | None:
    """Way points (map, metres) from a pose to the cheapest of the wanted cells; None where no way leads there."""
    start = grid.cell(pose.x_m, pose.y_m)
    if not grid.contains(start):
        return None
    found = shortest_path(cell_costs(grid, start, blocked), start, lambda cell: cell in wanted)
    return None if found is None else pull_string(grid, found[0], blocked)


def cell_costs(grid: GridMap, start: Cell, blocked: Mask | None = None) -> list[list[float]]:
    """(rows, columns) cost of a step of one cell: its metres, dear where the hull hardly fits; 0 where it does not."""
    clearance = grid.clearance_m
    allowed = (grid.cells == FREE) & (clearance >= TIGHT_CLEARANCE_M)
    if blocked is not None:
        allowed &= ~blocked
    r0, c0 = max(start[0] - START_RADIUS_CELLS, 0), max(start[1] - START_RADIUS_CELLS, 0)
    near = np.s_[r0 : start[0] + START_RADIUS_CELLS + 1, c0 : start[1] + START_RADIUS_CELLS + 1]
    price = 1.0 + COMFORT_WEIGHT * np.maximum(COMFORT_M - clearance, 0.0) / COMFORT_M
    price = np.where(allowed, np.where(grid.standable, price, TIGHT_PRICE), 0.0)
    here = (grid.cells[near] == FREE) & (price[near] == 0.0)
    if blocked is not None and grid.contains(start) and not blocked[start]:
        here &= ~blocked[near]
    price[near] = np.where(here, TIGHT_PRICE, price[near])
    costs: list[list[float]] = (price * grid.cell_m).tolist()
    return costs


def shortest_path(
    costs: list[list[float]], start: Cell, is_goal: Callable[[Cell], bool]
) -> tuple[list[Cell], float] | None:
    """Cells from `start` to the cheapest goal and the cost, or None where no goal can be reached (Dijkstra 1959).

    `costs` as of `cell_costs`; a diagonal step costs the square root of two times as much.
    """
    rows, columns = len(costs), len(costs[0])
    if not (0 <= start[0] < rows and 0 <= start[1] < columns):
        return None
    best: dict[Cell, float] = {start: 0.0}
    parent: dict[Cell, Cell] = {}
    queue: list[tuple[float, Cell]] = [(0.0, start)]
    while queue:
        cost, cell = heapq.heappop(queue)
        if cost > best[cell]:
            continue
        if is_goal(cell):
            path = [cell]
            while path[-1] in parent:
                path.append(parent[path[-1]])
            return path[::-1], cost
        for i, j, length in _NEIGHBOURS:
            r, c = cell[0] + i, cell[1] + j
            if not (0 <= r < rows and 0 <= c < columns):
                continue
            price = costs[r][c]
            if price == 0.0:
                continue
            total = cost + price * length
            if total < best.get((r, c), float("inf")):
                best[(r, c)] = total
                parent[(r, c)] = cell
                heapq.heappush(queue, (total, (r, c)))
    return None


def pull_string(grid: GridMap, cells: list[Cell], blocked: Mask | None = None) -> list[tuple[float, float]]:
    """Way points (map, metres): as few straight legs as keep the clearance that the path itself keeps."""
    points = [grid.centre(c) for c in cells]
    clearance = [float(grid.clearance_m[c]) for c in cells]
    way = [points[0]]
    at = 0
    while at < len(points) - 1:
        reach = at + 1
        step = 1
        while at + step < len(points):
            end = at + step
            wanted = min(min(clearance[at : end + 1]), 0.6) - 0.5 * grid.cell_m
            least_m = max(wanted, STAND_CLEARANCE_M - grid.cell_m)
            if not straight_is_clear(grid, points[at], points[end], least_m, blocked):
                break
            reach = end
            step += max(1, step // 3)
        way.append(points[reach])
        at = reach
    return way


def straight_is_clear(
    grid: GridMap, a: tuple[float, float], b: tuple[float, float], clearance_m: float, blocked: Mask | None = None
) -> bool:
    """Only free cells with that clearance, none of them blocked, between two positions."""
    rows, columns = grid.line(a, b)
    clear = (grid.clearance_m[rows, columns] >= clearance_m) & (grid.cells[rows, columns] == FREE)
    if blocked is not None:
        clear &= ~blocked[rows, columns]
    return bool(clear.all())
