"""Cells of the grid that zones keep the robot out of: they are no floor for route search and frontier alike. Pure.

A cell that is kept out holds NO_GO more than it would, unless it is a wall, so that what lies behind is known still.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, hypot

import numpy as np
import numpy.typing as npt

from common.grid_cells import WALL
from common.zones import Zone, ZoneKind

NO_GO = 4  # is added to UNKNOWN and FREE
# Beyond the border: no sonar sees it, so what the pose is wrong by counts in full
MARGIN_M = 0.2

Cells = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]


def marked(cells: Cells, origin_m: tuple[float, float], cell_m: float, zones: Sequence[Zone]) -> Cells:
    """The cells (rows, columns) with those marked that are kept out; `origin_m`: outer corner of cell (0, 0)."""
    if not zones:
        return cells
    out = _kept_out(cells.shape, origin_m, cell_m, zones)
    return np.where(out & (cells != WALL), cells | NO_GO, cells).astype(np.uint8)


def unmarked(cells: Cells) -> Cells:
    """As if nothing were kept out."""
    return cells & np.uint8(NO_GO - 1)


def _kept_out(shape: tuple[int, ...], origin_m: tuple[float, float], cell_m: float, zones: Sequence[Zone]) -> Mask:
    """(rows, columns): cells less than MARGIN_M beyond a border, or behind it."""
    reach = ceil(MARGIN_M / cell_m)
    wide = shape[0] + 2 * reach, shape[1] + 2 * reach
    out, inside_one, alone = np.zeros(wide, bool), np.zeros(wide, bool), False
    for zone in zones:
        # In cells, counted from the centre of the first
        ring = (np.array(zone.corners_m) - origin_m) / cell_m - 0.5 + reach
        if zone.kind is ZoneKind.ONLY:
            inside_one |= _inside(wide, ring)
            alone = True
            continue
        if zone.kind is ZoneKind.AREA:
            out |= _inside(wide, ring)
        _mark_sides(out, ring, closed=zone.kind is ZoneKind.AREA)
    if alone:
        out |= ~inside_one
    return _grown(out, reach, MARGIN_M / cell_m)


def _inside(shape: tuple[int, int], ring: npt.NDArray[np.float64]) -> Mask:
    """Cells with their centre inside of a ring (N, 2: column, row), by the even-odd rule."""
    rows, columns = shape
    toggles = np.zeros((rows, columns + 1), bool)
    for (x0, y0), (x1, y1) in zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True):
        low, high = sorted((y0, y1))
        row = np.arange(max(ceil(low), 0), min(ceil(high), rows))
        if len(row):
            x = x0 + (row - y0) * ((x1 - x0) / (y1 - y0))
            toggles[row, np.clip(np.ceil(x), 0, columns).astype(np.int64)] ^= True
    return np.asarray(np.logical_xor.accumulate(toggles, axis=1)[:, :columns])


def _mark_sides(mask: Mask, ring: npt.NDArray[np.float64], closed: bool) -> None:
    """The cells on a line: a line has no inside, and a slim area no centre of a cell."""
    ends = np.roll(ring, -1, axis=0)
    for a, b in list(zip(ring, ends, strict=True))[: len(ring) if closed else len(ring) - 1]:
        steps = 2 * ceil(hypot(*(b - a))) + 1
        at = np.rint(a + np.linspace(0.0, 1.0, steps + 1)[:, None] * (b - a)).astype(np.int64)
        at = at[((at >= 0) & (at < np.array(mask.shape[::-1]))).all(axis=1)]
        mask[at[:, 1], at[:, 0]] = True


def _grown(mask: Mask, reach: int, radius: float) -> Mask:
    """The part of a mask without its border of `reach` cells, grown by `radius` cells."""
    rows, columns = mask.shape[0] - 2 * reach, mask.shape[1] - 2 * reach
    grown = np.zeros((rows, columns), bool)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            if hypot(i, j) <= radius + 1e-6:
                grown |= mask[reach + i : reach + i + rows, reach + j : reach + j + columns]
    return grown
