"""How far it is between places on the known floor, for choosing their order: shortest paths over blocks of cells.

A block is BLOCK_CELLS along both axes, so small that no wall can run between two of its passable cells. It leads to
those of its eight neighbours that a step from a passable cell to a passable cell leads to. There are a sixteenth as
many blocks as cells, on which a path is searched.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from common.geometry import FloatArray
from onboard.planner.grid.grid_map import Cell, Mask
from onboard.planner.routing.route_planning import Prices

BLOCK_CELLS = 4
_STEPS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)

Neighbours = dict[int, list[tuple[int, float]]]  # blocks by number: which they lead to, and how many blocks far


class WalkingDistances:
    """On one grid, given by the prices of its cells."""

    def __init__(self, prices: Prices, cell_m: float) -> None:
        passable = np.array(prices.by_kind)[prices.kinds[1:-1, 1:-1]] > 0.0
        self._block_m = BLOCK_CELLS * cell_m
        self._columns: int = -(-passable.shape[1] // BLOCK_CELLS)
        self._neighbours = _neighbours(passable)

    def of(self, start: Cell, goals: Sequence[Cell]) -> FloatArray:
        """From one cell of the grid to others (N,), metres; infinite where no path leads."""
        blocks = [self._block(goal) for goal in goals]
        return np.array(_from(self._block(start), blocks, self._neighbours)) * self._block_m

    def _block(self, cell: Cell) -> int:
        return cell[0] // BLOCK_CELLS * self._columns + cell[1] // BLOCK_CELLS


def _neighbours(passable: Mask) -> Neighbours:
    rows, columns = (-(-side // BLOCK_CELLS) for side in passable.shape)
    bordered = np.zeros((rows * BLOCK_CELLS + 2, columns * BLOCK_CELLS + 2), dtype=bool)
    bordered[1 : passable.shape[0] + 1, 1 : passable.shape[1] + 1] = passable
    inside = bordered[1:-1, 1:-1]
    found: Neighbours = {}
    for i, j in _STEPS:
        there = bordered[1 + i : bordered.shape[0] - 1 + i, 1 + j : bordered.shape[1] - 1 + j]
        steps = (inside & there).reshape(rows, BLOCK_CELLS, columns, BLOCK_CELLS)
        leads = steps[:, _edge(i)][:, :, :, _edge(j)].any(axis=(1, 3))
        for block in np.flatnonzero(leads).tolist():
            found.setdefault(block, []).append((block + i * columns + j, sqrt(i * i + j * j)))
    return found


def _edge(step: int) -> slice:
    """The cells of a block, along one axis, from which such a step leaves it."""
    return np.s_[:] if step == 0 else np.s_[-1:] if step > 0 else np.s_[:1]


def _from(start: int, goals: Sequence[int], neighbours: Neighbours) -> list[float]:
    """How many blocks far others are from one (Dijkstra 1959)."""
    best, left, queue = {start: 0.0}, set(goals), [(0.0, start)]
    while queue and left:
        cost, block = heapq.heappop(queue)
        if cost > best[block]:
            continue
        left.discard(block)
        for near, length in neighbours.get(block, ()):
            total = cost + length
            if total < best.get(near, inf):
                best[near] = total
                heapq.heappush(queue, (total, near))
    return [inf if goal in left else best[goal] for goal in goals]
