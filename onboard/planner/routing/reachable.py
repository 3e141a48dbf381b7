"""Which cells paths lead to from one: those that hang together with it, found by runs of cells along the rows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from onboard.planner.grid.grid_map import Cell, Mask
from onboard.planner.routing.route_planning import Prices

BESIDE_CELLS = 2  # of the start: a robot on a cell that an echo made a wall of stands beside floor


def reachable(prices: Prices, start: Cell) -> Mask:
    """Passable cells (rows, columns) that steps to any of eight neighbours lead to, from a cell or beside it."""
    passable = (np.array(prices.by_kind) > 0.0)[prices.kinds]  # with a border, where no run goes on
    width = passable.shape[1]
    ends = np.flatnonzero(np.diff(passable.ravel(), prepend=False, append=False))
    first, last = ends[::2], ends[1::2] - 1  # of each run, in the order of the rows
    found = np.zeros(len(first), dtype=bool)
    stack = _runs_beside(first, last, start, width).tolist()
    found[stack] = True
    # A run touches those of a row beside it that lie between its ends and one cell further
    sides = [
        (np.searchsorted(last, first + step - 1), np.searchsorted(first, last + step + 1, side="right"))
        for step in (-width, width)
    ]
    touched, reached = [(low.data, high.data) for low, high in sides], found.data
    while stack:
        run = stack.pop()
        for low, high in touched:
            for near in range(low[run], high[run]):
                if not reached[near]:
                    reached[near] = True
                    stack.append(near)
    changes = np.zeros(passable.size + 1, np.int8)
    changes[first[found]], changes[last[found] + 1] = 1, -1
    cells: Mask = np.cumsum(changes[:-1], dtype=np.int8).view(bool).reshape(passable.shape)[1:-1, 1:-1]
    return cells


def _runs_beside(
    first: npt.NDArray[np.int64], last: npt.NDArray[np.int64], start: Cell, width: int
) -> npt.NDArray[np.int64]:
    """The runs (N,) with cells up to BESIDE_CELLS from the start along both axes."""
    rows = np.arange(-BESIDE_CELLS, BESIDE_CELLS + 1) + start[0] + 1
    low = np.searchsorted(last, rows * width + start[1] + 1 - BESIDE_CELLS)
    high = np.searchsorted(first, rows * width + start[1] + 1 + BESIDE_CELLS, side="right")
    return np.unique(np.concatenate([np.arange(*ends) for ends in zip(low, high, strict=True)]))
