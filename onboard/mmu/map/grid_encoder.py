"""The occupancy grid as a message, compressed a few rows at a time: the cost of a step does not grow with the map.

The rows of one message are up to a second apart; rows that the map gained meanwhile come with the next message.
"""

from __future__ import annotations

import logging
import zlib
from copy import copy

from common.fields import GRID_CELLS_MAX
from common.messages.mapping import GridUpdate
from onboard.mmu.map.occupancy import CELL_M, OccupancyGrid

CELLS_AT_ONCE = 100_000  # in a step: bounds its time, see `indoor-mapping bench mapping`
LEVEL = 1  # of zlib: a grid is mostly long runs of one value

_log = logging.getLogger("mmu")


class GridEncoder:
    """`begin` with a grid, then `advance` in every step until it gives the message."""

    def __init__(self) -> None:
        self._revision = 0
        self._grid: OccupancyGrid | None = None
        self._too_large = False

    @property
    def busy(self) -> bool:
        return self._grid is not None

    def begin(self, grid: OccupancyGrid) -> None:
        """A grid that no message can hold is left out: the Planner goes on with the newest one that it has."""
        rows, columns = grid.shape
        if rows * columns > GRID_CELLS_MAX:
            if not self._too_large:
                _log.warning("the floor is too large for one map rows=%d columns=%d: map it in parts", rows, columns)
            self._too_large = True
            return
        # A shallow copy: a grid that grows takes new arrays, this one keeps its own
        self._grid = copy(grid)
        self._deflate = zlib.compressobj(LEVEL)
        self._compressed = bytearray()
        self._row = 0

    def advance(self, now_s: float) -> GridUpdate | None:
        """The message once all of the grid is in it; None before, and while nothing was begun."""
        grid = self._grid
        if grid is None:
            return None
        rows, columns = grid.shape
        end = min(self._row + max(CELLS_AT_ONCE // columns, 1), rows)
        self._compressed += self._deflate.compress(grid.cells(self._row, end).tobytes())
        self._row = end
        if end < rows:
            return None
        self._grid = None
        self._revision += 1
        self._compressed += self._deflate.flush()
        return GridUpdate(now_s, self._revision, *grid.origin_m, CELL_M, rows, columns, bytes(self._compressed))
