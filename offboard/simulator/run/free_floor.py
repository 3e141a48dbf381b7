"""Where the robot can drive on a floor, for scripted drives: the corridor in cells of 10 cm, and the cheapest paths."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from common.constants import FOOTPRINT_RADIUS_M, PLANNER_CLEARANCE_M
from common.geometry import FloatArray, Points
from offboard.simulator.building.floor import Floor, wall_segments
from offboard.simulator.building.polygons import distances_m

CELL_M = 0.1
MIDDLE_WEIGHT = 6.0  # extra cost of a metre at a wall, in metres
CLEARANCE_M = FOOTPRINT_RADIUS_M + PLANNER_CLEARANCE_M
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))

Mask = npt.NDArray[np.bool_]


class FreeFloor:
    """`open`: cells (rows, columns) that the robot can drive on; `places`: their middles (N, 2) in metres."""

    def __init__(self, floor: Floor) -> None:
        rings = [np.array(ring, dtype=np.float64) for ring in (floor.exterior, *floor.holes)]
        self._low = rings[0].min(axis=0) - 2 * CELL_M
        columns, rows = np.ceil((rings[0].max(axis=0) - self._low) / CELL_M).astype(int) + 3
        free = np.zeros((rows, columns), np.uint8)
        cv2.fillPoly(free, [np.round((ring - self._low) / CELL_M).astype(np.int32) for ring in rings], (1,))
        self.clearance_m: FloatArray = np.zeros(free.shape)
        walls, x_m = wall_segments(floor), self._low[0] + np.arange(columns)[:, None] * CELL_M
        for row, inside in enumerate(free.astype(bool)):
            y_m = float(self._low[1] + row * CELL_M)
            self.clearance_m[row, inside] = distances_m(walls, x_m[inside], y_m).min(axis=1, initial=np.inf)
        self.open: Mask = self.clearance_m >= CLEARANCE_M
        self._node = np.full(free.shape, -1)
        self._node[self.open] = np.arange(int(self.open.sum()))
        self.places: Points = np.argwhere(self.open)[:, ::-1] * CELL_M + self._low
        self._graph = self._neighbour_graph()

    def _neighbour_graph(self) -> csr_matrix:
        """Neighbouring open cells as edges, weighted by the cost of driving between them."""
        price = 1.0 + MIDDLE_WEIGHT * np.exp(-self.clearance_m / 0.4)
        first, second, cost = [], [], []
        rows, columns = self.open.shape
        for dy, dx in STEPS:
            here = np.s_[: rows - dy, max(-dx, 0) : columns - max(dx, 0)]
            there = np.s_[dy:, max(dx, 0) : columns - max(-dx, 0)]
            both = self.open[here] & self.open[there]
            first.append(self._node[here][both])
            second.append(self._node[there][both])
            cost.append(((price[here] + price[there]) / 2)[both] * CELL_M * float(np.hypot(dx, dy)))
        edges = np.concatenate(first), np.concatenate(second)
        return csr_matrix((np.concatenate(cost), edges), shape=(len(self.places),) * 2)

    def nearest(self, place: Points) -> int:
        """The index of the open cell nearest to a place (2,)."""
        return int(np.hypot(*(self.places - place).T).argmin())

    def is_open(self, points: Points) -> Mask:
        """(N,) of points (N, 2): does each lie in an open cell?"""
        at = np.round((points - self._low) / CELL_M).astype(int)
        inside = (at >= 0).all(axis=1) & (at[:, 0] < self.open.shape[1]) & (at[:, 1] < self.open.shape[0])
        at[~inside] = 0
        return np.asarray(inside & self.open[at[:, 1], at[:, 0]])

    def costs_from(self, cell: int) -> tuple[FloatArray, npt.NDArray[np.int32]]:
        """The cost of every open cell on the cheapest path, infinite where there is none, and the cell before each."""
        costs, befores = dijkstra(self._graph, directed=False, indices=[cell], return_predecessors=True)
        return costs[0], befores[0]


def path_to(goal: int, cell: int, before: npt.NDArray[np.int32]) -> list[int]:
    """The cells from `cell`, from which `before` leads away, to the goal, both included."""
    path = [goal]
    while path[-1] != cell:
        path.append(int(before[path[-1]]))
    return path[::-1]
