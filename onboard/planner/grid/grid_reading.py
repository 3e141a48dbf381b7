"""The grid's message -> `GridMap`, tile by tile: what a floor of any size takes in memory besides is bounded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from common.grid_cells import cells_of
from common.messages.mapping import GridUpdate
from common.zones import Zone
from onboard.planner.grid.grid_map import CLEARANCE_MAX_CELLS, SLIVER_PASSES, GridMap, close_slivers
from onboard.planner.zones.zone_cells import NO_GO, marked, unmarked

MARGIN_CELLS = 4  # around what is known
TILE_CELLS = 400  # along both axes
HALO_CELLS = CLEARANCE_MAX_CELLS + SLIVER_PASSES + 3  # around a tile: as far as one cell matters to another

Part = tuple[slice, slice]  # rows, columns


class GridError(ValueError):
    """This message is no grid; the message is one sentence with the reason."""


def read(update: GridUpdate, zones: Sequence[Zone] = ()) -> GridMap:
    """What is known of the grid, with a margin, the gaps between neighbouring rays closed, and what `zones` keep the
    robot out of marked.

    Raises GridError when the cells cannot be unpacked or do not fill the announced shape.
    """
    try:
        raw = cells_of(update)
    except ValueError as error:
        raise GridError(str(error)) from error
    rows, columns = np.flatnonzero(raw.any(axis=1)), np.flatnonzero(raw.any(axis=0))
    if not len(rows):
        return GridMap(raw, update.origin_x_m, update.origin_y_m, update.cell_m)
    r0, c0 = max(int(rows[0]) - MARGIN_CELLS, 0), max(int(columns[0]) - MARGIN_CELLS, 0)
    raw = raw[r0 : int(rows[-1]) + MARGIN_CELLS + 1, c0 : int(columns[-1]) + MARGIN_CELLS + 1]
    origin_x_m, origin_y_m = (
        update.origin_x_m + float(c0) * update.cell_m,
        update.origin_y_m + float(r0) * update.cell_m,
    )
    return _tile_by_tile(
        GridMap(marked(raw, (origin_x_m, origin_y_m), update.cell_m, zones), origin_x_m, origin_y_m, update.cell_m)
    )


def without_zones(grid: GridMap) -> GridMap:
    """As it would be if nothing were kept out; the same where nothing is."""
    if not (grid.cells >= NO_GO).any():
        return grid
    return _tile_by_tile(replace(grid, cells=unmarked(grid.cells)))


def _tile_by_tile(grid: GridMap) -> GridMap:
    """The gaps closed, clearance and frontier computed."""
    raw = grid.cells
    cells, frontier = np.empty(raw.shape, np.uint8), np.empty(raw.shape, np.bool_)
    wall_distance2 = np.empty(raw.shape, np.int16)
    for tile, around, inside in tiles(raw.shape, TILE_CELLS, HALO_CELLS):
        part = replace(grid, cells=close_slivers(raw[around]))
        cells[tile], wall_distance2[tile] = part.cells[inside], part.wall_distance2[inside]
        frontier[tile] = part.frontier[inside]
    grid = replace(grid, cells=cells)
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
