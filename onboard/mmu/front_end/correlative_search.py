"""Correlative search with branch and bound: where, within a wide window, do these echoes fit onto those?

After Olson 2009; the bounds after Hess et al. 2016.

1. The fixed points smear a likelihood over a grid of 10 cm cells, one grid for each of eight directions that a wall
   may face, so that the two sides of a wall, or crossing walls, do not match each other.
2. Every heading and every block of 4 x 4 cells gets an upper bound of its scores from a grid of block maxima.
3. Blocks are scored cell by cell, best bound first, as long as their bound may still matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points

# Resolution of the search, and its prior on the middle of the window. The sensitivity was not measured
CELL_M = 0.1
SMEAR_M = 0.12
HEADING_STEP_RAD = 0.02
BLOCK = 4
SECTORS = 8
POINTS_MAX = 160
PRIOR_SHARE = 0.1  # of the score that the rim of the window loses against its middle
SECOND_BEST_SHARE = 0.8  # places that score less than this share of the best are not returned
CHUNK = 256
MARGIN_M = 0.5

_FULL_SCORE = 255.0


@dataclass(frozen=True, slots=True)
class Place:
    """A shift (metres) and turn (radians) about the centre, and the share of the points that agree there."""

    x_m: float
    y_m: float
    turn_rad: float
    score: float


def search(
    points: Points,
    normals_rad: FloatArray,
    fixed: Points,
    fixed_normals_rad: FloatArray,
    reach_m: float,
    reach_rad: float,
) -> list[Place]:
    """The best place first, then all cells that score nearly as well (at their best heading), relative to the centre.

    `points` (N, 2) are moved, `fixed` (M, 2) stay. Empty when nothing agrees anywhere.
    """
    stride = max(1, -(-len(points) // POINTS_MAX))
    points, normals_rad = points[::stride], normals_rad[::stride]
    reach = BLOCK * max(1, round(reach_m / CELL_M / BLOCK))
    span_m = float(np.hypot(points[:, 0], points[:, 1]).max()) + reach * CELL_M + MARGIN_M
    half = int(np.ceil(span_m / CELL_M)) + BLOCK
    field = _likelihood(fixed, fixed_normals_rad, half)
    blocks = _block_maxima(field)
    width = field.shape[1]
    steps = round(reach_rad / HEADING_STEP_RAD)
    turns = HEADING_STEP_RAD * np.arange(-steps, steps + 1, dtype=np.float64)
    base = np.stack([_cells(points, normals_rad, turn, half, width) for turn in turns])  # (T, N)
    offsets = np.arange(-reach, reach + 1, BLOCK)
    dy, dx = (a.ravel() for a in np.meshgrid(offsets, offsets, indexing="ij"))
    flat_blocks = blocks.ravel()
    bound = np.empty((len(turns), len(dx)))
    for t in range(len(turns)):
        bound[t] = flat_blocks[base[t][None, :] + (dy * width + dx)[:, None]].mean(axis=1)
    return _refine(field.ravel(), base, bound, turns, dy, dx, width, reach)


def _refine(
    field: npt.NDArray[np.uint8],
    base: npt.NDArray[np.int64],
    bound: FloatArray,
    turns: FloatArray,
    dy: npt.NDArray[np.int64],
    dx: npt.NDArray[np.int64],
    width: int,
    reach: int,
) -> list[Place]:
    inner_y, inner_x = (a.ravel() for a in np.meshgrid(np.arange(BLOCK), np.arange(BLOCK), indexing="ij"))
    order = np.argsort(-bound, axis=None, kind="stable")
    bounds = bound.ravel()[order]
    best, at = 0.0, 0
    found: list[FloatArray] = []  # rows of score, x, y, turn
    while at < len(order) and bounds[at] > SECOND_BEST_SHARE * best and bounds[at] > 0:
        t, b = np.unravel_index(order[at : at + CHUNK], bound.shape)
        at += CHUNK
        y, x = dy[b][:, None] + inner_y[None, :], dx[b][:, None] + inner_x[None, :]
        score = field[base[t][:, None, :] + (y * width + x)[:, :, None]].mean(axis=2)
        score = score * (1.0 - PRIOR_SHARE * np.minimum(np.hypot(x, y) / reach, 1.0))
        best = max(best, float(score.max()))
        rows = np.stack([score, x * CELL_M, y * CELL_M, np.broadcast_to(turns[t][:, None], score.shape)], axis=-1)
        found.append(rows.reshape(-1, 4))
    if best <= 0:
        return []
    rows = np.concatenate(found)
    rows = rows[rows[:, 0] > SECOND_BEST_SHARE * best]
    rows = rows[np.argsort(-rows[:, 0], kind="stable")]
    cells = np.round(rows[:, 1:3] / CELL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return [Place(float(r[1]), float(r[2]), float(r[3]), float(r[0]) / _FULL_SCORE) for r in rows[np.sort(first)]]


def _cells(points: Points, normals_rad: FloatArray, turn_rad: float, half: int, width: int) -> npt.NDArray[np.int64]:
    """Flat indices (N,) of the points, turned, in the grid of the sector that their normals face."""
    c, s = cos(turn_rad), sin(turn_rad)
    moved = points @ np.array([[c, s], [-s, c]])
    cell = np.round(moved / CELL_M).astype(np.int64) + half
    sector = np.round((normals_rad + turn_rad) / (2 * pi / SECTORS)).astype(np.int64) % SECTORS
    flat: npt.NDArray[np.int64] = (sector * width + cell[:, 1]) * width + cell[:, 0]
    return flat


def _likelihood(fixed: Points, normals_rad: FloatArray, half: int) -> npt.NDArray[np.uint8]:
    """(sectors, rows along y, columns along x): 255 at a fixed point, fading around it."""
    width = 2 * half + 1
    field = np.zeros((SECTORS, width, width), np.uint8)
    reach = int(2.5 * SMEAR_M / CELL_M)
    cell = np.round(fixed / CELL_M).astype(np.int64) + half
    inside = ((cell >= reach) & (cell < width - reach)).all(axis=1)
    exact = normals_rad[inside] / (2 * pi / SECTORS)
    cell = cell[inside]
    nearest = np.round(exact).astype(np.int64)
    beside = nearest + np.where(exact > nearest, 1, -1)
    index = np.unique(
        np.concatenate([np.column_stack([k % SECTORS, cell[:, 1], cell[:, 0]]) for k in (nearest, beside)]), axis=0
    )
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            value = np.uint8(_FULL_SCORE * np.exp(-0.5 * (i * i + j * j) * (CELL_M / SMEAR_M) ** 2))
            view = (index[:, 0], index[:, 1] + i, index[:, 2] + j)
            field[view] = np.maximum(field[view], value)
    return field


def _block_maxima(field: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """At every cell the maximum over the block of 4 x 4 cells that begins there."""
    out = field.copy()
    for axis in (1, 2):
        for shift in (1, 2):  # windows of 2, then of 4
            moved = np.roll(out, -shift, axis=axis)
            out = np.maximum(out, moved)
    return out
