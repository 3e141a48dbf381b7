"""Where do these echoes fit onto those? Registration of one set of wall points with normals onto another.

1. Coarse: correlative search (Olson 2009) of the moving points over a smeared grid of the fixed ones, every
   heading and offset of the search window; keeps the best and how good its best rival is.
2. Fine: point-to-line least squares with normals (Chen and Medioni 1992), robust weights, neighbours by KD-tree.

The information matrix is that of the point-to-line problem: along a bare hall it stays near zero by itself.
Assumes that both sets are rigid: a few metres of driving each.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from scipy.spatial import cKDTree

from common.geometry import FloatArray, Points, Pose2

CELL_M = 0.1
SMEAR_M = 0.15
HEADING_STEP_RAD = 0.02
NEIGHBOUR_M = 0.30
NEIGHBOUR_FINAL_M = 0.15
NORMALS_COS_MIN = 0.85
POINT_SD_M = 0.03
POINTS_PER_INDEPENDENT = 6.0  # neighbouring echoes share their errors
ITERATIONS = 8


@dataclass(frozen=True, slots=True)
class Match:
    """`correction` brings the moving points (given in the map as believed) onto the fixed ones."""

    correction: Pose2
    information: FloatArray  # (3, 3) of the correction, about the centre given to `register`
    overlap: float  # share of the moving points that found a partner
    rms_m: float
    rival: float  # score of the best other place over the best; 0 where nothing was searched


def register(
    points: Points,
    normals: Points,
    fixed_points: Points,
    fixed_normals: Points,
    centre: Points,
    search_m: float,
    search_rad: float,
) -> Match | None:
    """Match `points` (N, 2) with `normals` (N, 2) onto `fixed_points` (M, 2); rotation is about `centre` (2,).

    Returns None where there is nothing to hold on to.
    """
    local = points - centre
    fixed = fixed_points - centre
    start, rival = np.zeros(3), 0.0
    if search_m > CELL_M:
        start, rival = _correlate(local, fixed, search_m, search_rad)
    tree = cKDTree(fixed)
    correction = start
    information = np.zeros((3, 3))
    used = np.zeros(len(points), dtype=bool)
    rms_m = 0.0
    for iteration in range(ITERATIONS):
        moved, turned = _move(correction, local, normals)
        gate_m = max(NEIGHBOUR_M * 0.7**iteration, NEIGHBOUR_FINAL_M)
        distance_m, index = tree.query(moved, distance_upper_bound=gate_m)
        used = np.isfinite(distance_m)
        index = np.where(used, index, 0)
        used &= (turned * fixed_normals[index]).sum(axis=1) > NORMALS_COS_MIN
        if used.sum() < 8:
            return None
        p, n = moved[used], fixed_normals[index[used]]
        residual = ((p - fixed[index[used]]) * n).sum(axis=1)
        weight = 1.0 / (1.0 + (residual / (2 * POINT_SD_M)) ** 2)
        jacobian = np.stack([n[:, 0], n[:, 1], p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]], axis=1)
        hessian = (jacobian * weight[:, None]).T @ jacobian
        step = np.linalg.solve(hessian + np.diag([0.5, 0.5, 0.5]), (jacobian * weight[:, None]).T @ residual)
        correction = _compose(-step, correction)
        information = hessian
        rms_m = float(np.sqrt((weight * residual**2).sum() / weight.sum()))
        if abs(step[:2]).max() < 1e-3 and abs(step[2]) < 1e-4 and gate_m == NEIGHBOUR_FINAL_M:
            break
    information = information / (POINT_SD_M**2 * POINTS_PER_INDEPENDENT)
    return Match(Pose2.from_array(correction), information, float(used.mean()), rms_m, rival)


def _move(correction: FloatArray, points: Points, normals: Points) -> tuple[Points, Points]:
    c, s = cos(correction[2]), sin(correction[2])
    rotation = np.array([[c, -s], [s, c]])
    return points @ rotation.T + correction[:2], normals @ rotation.T


def _compose(step: FloatArray, before: FloatArray) -> FloatArray:
    c, s = cos(step[2]), sin(step[2])
    return np.array(
        [
            step[0] + c * before[0] - s * before[1],
            step[1] + s * before[0] + c * before[1],
            step[2] + before[2],
        ]
    )


def _correlate(points: Points, fixed: Points, search_m: float, search_rad: float) -> tuple[FloatArray, float]:
    """Best (dx, dy, turn) on the grid of the search window, and the score of its best rival over its own."""
    low = points.min(axis=0) - search_m - 1.0
    shape = np.ceil((points.max(axis=0) + search_m + 1.0 - low) / CELL_M).astype(int) + 1
    field = _smear(fixed, low, shape)
    reach = int(search_m / CELL_M)
    offsets = np.arange(-reach, reach + 1)
    flat = (offsets[:, None] * shape[1] + offsets[None, :]).ravel()
    prior = 1.0 - 0.1 * np.hypot(offsets[:, None], offsets[None, :]).ravel() / max(reach, 1)
    turns = np.arange(-search_rad, search_rad + 1e-9, HEADING_STEP_RAD)
    scores = np.empty((len(turns), len(flat)))
    sub = points[:: max(1, len(points) // 150)]
    for k, turn in enumerate(turns):
        c, s = cos(turn), sin(turn)
        moved = sub @ np.array([[c, s], [-s, c]])
        cell = np.clip(((moved - low) / CELL_M + 0.5).astype(int), reach, shape - 1 - reach)
        index = cell[:, 0] * shape[1] + cell[:, 1]
        scores[k] = field.ravel()[index[:, None] + flat[None, :]].mean(axis=0) * prior
    k, j = (int(i) for i in np.unravel_index(int(scores.argmax()), scores.shape))
    dx, dy = offsets[j // len(offsets)], offsets[j % len(offsets)]
    far = (np.hypot(offsets[:, None] - dx, offsets[None, :] - dy) * CELL_M > 0.6).ravel()
    rival = float(scores[:, far].max() / max(scores[k, j], 1e-9)) if far.any() else 0.0
    return np.array([dx * CELL_M, dy * CELL_M, turns[k]]), rival


def _smear(fixed: Points, low: Points, shape: FloatArray) -> FloatArray:
    field = np.zeros((int(shape[0]), int(shape[1])))
    reach = int(2 * SMEAR_M / CELL_M)
    cell = ((fixed - low) / CELL_M + 0.5).astype(int)
    inside = ((cell >= reach) & (cell < shape - reach)).all(axis=1)
    cell = np.unique(cell[inside], axis=0)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            value = float(np.exp(-0.5 * (i * i + j * j) * (CELL_M / SMEAR_M) ** 2))
            view = (cell[:, 0] + i, cell[:, 1] + j)
            field[view] = np.maximum(field[view], value)
    return field
