"""The grid's message -> `GridMap`, where it changed, tile by tile: what that takes in memory besides is bounded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from common.grid_cells import UNKNOWN, cells_of
from common.messages.mapping import GridUpdate
from common.zones import Zone
from onboard.planner.grid.grid_map import (
    CLEARANCE_MAX_CELLS,
    SLIVER_PASSES,
    Cell,
    GridMap,
    Mask,
    close_slivers,
)
from onboard.planner.zones.zone_cells import NO_GO, marked, unmarked

MARGIN_CELLS = 4  # around what is known
TILE_CELLS = 400  # along both axes
HALO_CELLS = CLEARANCE_MAX_CELLS + SLIVER_PASSES + 3  # around a tile: as far as one cell matters to another

Part = tuple[slice, slice]  # rows, columns
Layers = tuple[npt.NDArray[Any], ...]  # (rows, columns) each


class GridError(ValueError):
    """This message is no grid; the message is one sentence with the reason."""


class GridReader:
    """Reads one grid after another: what a change reaches is computed, all else is as it was on the one before."""

    def __init__(self) -> None:
        self._raw: GridMap | None = None  # the newest that was read, as it came
        self._read: GridMap | None = None

    def read(self, update: GridUpdate, zones: Sequence[Zone] = ()) -> GridMap:
        """What is known of the grid, with a margin, the gaps between neighbouring rays closed, and what `zones` keep
        the robot out of marked.

        Raises GridError when the cells cannot be unpacked or do not fill the announced shape.
        """
        try:
            cells = cells_of(update)
        except ValueError as error:
            raise GridError(str(error)) from error
        rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        grid = GridMap(cells, update.origin_x_m, update.origin_y_m, update.cell_m)
        if not len(rows):
            return grid
        r0, c0 = max(int(rows[0]) - MARGIN_CELLS, 0), max(int(columns[0]) - MARGIN_CELLS, 0)
        grid = grid.part(np.s_[r0 : int(rows[-1]) + MARGIN_CELLS + 1, c0 : int(columns[-1]) + MARGIN_CELLS + 1])
        raw = replace(grid, cells=marked(grid.cells, (grid.origin_x_m, grid.origin_y_m), grid.cell_m, zones))
        read = _empty_like(raw)
        changed = raw.cells != UNKNOWN
        if self._raw is not None and self._read is not None and self._raw.cell_m == raw.cell_m:
            place = _place(self._raw, raw)
            before = np.zeros_like(raw.cells)
            _paste((self._raw.cells,), (before,), place)
            _paste(_layers(self._read), _layers(read), place)
            changed = raw.cells != before
        _compute(raw, read, _window(changed))
        self._raw, self._read = raw, read
        return read


def without_zones(grid: GridMap) -> GridMap:
    """As it would be if nothing were kept out; the same where nothing is."""
    if not (grid.cells >= NO_GO).any():
        return grid
    raw = replace(grid, cells=unmarked(grid.cells))
    read = _empty_like(raw)
    _compute(raw, read, np.s_[0 : raw.cells.shape[0], 0 : raw.cells.shape[1]])
    return read


def _empty_like(grid: GridMap) -> GridMap:
    """Of which nothing is known."""
    shape = grid.cells.shape
    empty = replace(grid, cells=np.zeros(shape, np.uint8))
    vars(empty).update(  # where its cached properties look
        wall_distance2=np.full(shape, CLEARANCE_MAX_CELLS**2, np.int16), frontier=np.zeros(shape, np.bool_)
    )
    return empty


def _place(grid: GridMap, on: GridMap) -> Cell:
    """Where its first cell lies on another."""
    return (
        round((grid.origin_y_m - on.origin_y_m) / on.cell_m),
        round((grid.origin_x_m - on.origin_x_m) / on.cell_m),
    )


def _paste(layers: Layers, into: Layers, place: Cell) -> None:
    """What both have the floor of."""
    for source, target in zip(layers, into, strict=True):
        rows_to, rows = _overlap(place[0], source.shape[0], target.shape[0])
        columns_to, columns = _overlap(place[1], source.shape[1], target.shape[1])
        target[rows_to, columns_to] = source[rows, columns]


def _overlap(first: int, count: int, room: int) -> tuple[slice, slice]:
    """Of `count` cells that begin at cell `first` of `room`: where they lie in it, and which of them do."""
    begin, end = max(first, 0), max(min(first + count, room), max(first, 0))
    return slice(begin, end), slice(begin - first, end - first)


def _layers(grid: GridMap) -> Layers:
    return grid.cells, grid.wall_distance2, grid.frontier


def _window(changed: Mask) -> Part:
    """All cells that a change matters to."""
    rows, columns = (np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return np.s_[0:0, 0:0]
    return (
        slice(max(int(rows[0]) - HALO_CELLS, 0), int(rows[-1]) + HALO_CELLS + 1),
        slice(max(int(columns[0]) - HALO_CELLS, 0), int(columns[-1]) + HALO_CELLS + 1),
    )


def _compute(raw: GridMap, read: GridMap, window: Part) -> None:
    """The gaps closed, clearance and frontier, in a part of the grid."""
    for tile, around, inside in tiles(raw.cells.shape, TILE_CELLS, HALO_CELLS, window):
        part = replace(raw, cells=close_slivers(raw.cells[around]))
        for source, target in zip(_layers(part), _layers(read), strict=True):
            target[tile] = source[inside]


def tiles(
    shape: tuple[int, int], side: int, halo: int, window: Part = (slice(0, None), slice(0, None))
) -> Iterator[tuple[Part, Part, Part]]:
    """Tiles that cover a window of an array: each, the same with up to `halo` cells around it, and where it lies in
    that."""
    (top, bottom, _), (left, right, _) = (part.indices(size) for part, size in zip(window, shape, strict=True))
    for r in range(top, bottom, side):
        for c in range(left, right, side):
            r0, c0 = max(r - halo, 0), max(c - halo, 0)
            r1, c1 = min(r + side, bottom), min(c + side, right)
            yield (
                (slice(r, r1), slice(c, c1)),
                (slice(r0, r1 + halo), slice(c0, c1 + halo)),
                (slice(r - r0, r1 - r0), slice(c - c0, c1 - c0)),
            )
