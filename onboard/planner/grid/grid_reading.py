"""The grid's message -> `GridMap`, tile by tile: a floor of any size is read in bounded slices."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from common.messages import GridUpdate
from onboard.planner.grid.grid_map import CLEARANCE_MAX_CELLS, SLIVER_PASSES, GridMap, close_slivers
from onboard.planner.grid.sliced_work import Sliced, Work

MARGIN_CELLS = 4  # around what is known
TILE_CELLS = 400  # along both axes
HALO_CELLS = CLEARANCE_MAX_CELLS + SLIVER_PASSES + 3  # around a tile: as far as one cell matters to another
CELLS_READ_PER_US = 12
CELLS_INFLATED_PER_US = 100
CELLS_AT_ONCE = 200_000  # of inflating, between two yields

Part = tuple[slice, slice]  # rows, columns


class GridError(ValueError):
    """This message is no grid; the message is one sentence with the reason."""


class GridReader:
    """The newest message is taken, and read in the steps that follow; one that comes meanwhile waits."""

    def __init__(self) -> None:
        self._waiting: GridUpdate | None = None
        self._reading: Sliced[GridMap] | None = None

    def take(self, update: GridUpdate) -> None:
        """This one is to be read next."""
        self._waiting = update

    def advance(self) -> GridMap | None:
        """The grid once it is read. Raises GridError where the message was none; then the next one is read."""
        if self._reading is None and self._waiting is not None:
            self._reading, self._waiting = Sliced(read(self._waiting)), None
        if self._reading is None:
            return None
        reading, self._reading = self._reading, None
        if reading.advance():
            return reading.result
        self._reading = reading
        return None


def read(update: GridUpdate) -> Work[GridMap]:
    """What is known of the grid, with a margin, the gaps between neighbouring rays closed.

    Raises GridError when the cells cannot be unpacked or do not fill the announced shape.
    """
    raw = (yield from _inflated(update.cells_zlib, update.rows * update.columns)).reshape(update.rows, update.columns)
    rows, columns = np.flatnonzero(raw.any(axis=1)), np.flatnonzero(raw.any(axis=0))
    if not len(rows):
        return GridMap(raw, update.origin_x_m, update.origin_y_m, update.cell_m)
    r0, c0 = max(int(rows[0]) - MARGIN_CELLS, 0), max(int(columns[0]) - MARGIN_CELLS, 0)
    raw = raw[r0 : int(rows[-1]) + MARGIN_CELLS + 1, c0 : int(columns[-1]) + MARGIN_CELLS + 1]
    origin_x_m, origin_y_m = (
        update.origin_x_m + float(c0) * update.cell_m,
        update.origin_y_m + float(r0) * update.cell_m,
    )
    cells, frontier = np.empty(raw.shape, np.uint8), np.empty(raw.shape, np.bool_)
    wall_distance2 = np.empty(raw.shape, np.int16)
    for tile, around, inside in tiles(raw.shape, TILE_CELLS, HALO_CELLS):
        part = GridMap(close_slivers(raw[around]), origin_x_m, origin_y_m, update.cell_m)
        cells[tile], wall_distance2[tile] = part.cells[inside], part.wall_distance2[inside]
        frontier[tile] = part.frontier[inside]
        yield part.cells.size // CELLS_READ_PER_US
    grid = GridMap(cells, origin_x_m, origin_y_m, update.cell_m)
    vars(grid).update(wall_distance2=wall_distance2, frontier=frontier)  # where its cached properties look
    return grid


def tiles(shape: tuple[int, int], side: int, halo: int) -> Iterator[tuple[Part, Part, Part]]:
    """Tiles that cover an array: each, the same with up to `halo` cells around it, and where it lies in that."""
    for r in range(0, shape[0], side):
        for c in range(0, shape[1], side):
            r0, c0 = max(r - halo, 0), max(c - halo, 0)
            r1, c1 = min(r + side, shape[0]), min(c + side, shape[1])
            yield (
                (slice(r, r1), slice(c, c1)),
                (slice(r0, r1 + halo), slice(c0, c1 + halo)),
                (slice(r - r0, r1 - r0), slice(c - c0, c1 - c0)),
            )


def _inflated(pressed: bytes, count: int) -> Work[npt.NDArray[np.uint8]]:
    """So many cells; a few bytes may claim to be gigabytes, so no more than these are unpacked."""
    inflater, cells, at = zlib.decompressobj(), np.empty(count, np.uint8), 0
    try:
        while piece := inflater.decompress(pressed, CELLS_AT_ONCE):
            if at + len(piece) > count:
                break
            cells[at : at + len(piece)] = np.frombuffer(piece, np.uint8)
            at, pressed = at + len(piece), inflater.unconsumed_tail
            yield len(piece) // CELLS_INFLATED_PER_US
    except zlib.error as error:
        raise GridError(str(error)) from error
    if piece or at != count or not inflater.eof:
        raise GridError(f"not the {count} cells of its rows and columns")
    return cells
