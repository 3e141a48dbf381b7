"""Scan matching: registration of one set of wall points with normals onto another.

1. Coarse, where a window is given: correlative search; another place that fits nearly as well makes it ambiguous.
2. Fine: point-to-line least squares with normals (Chen and Medioni 1992), robust weights, neighbours by KD-tree.

The information matrix is that of the point-to-line problem: along a bare hall it stays near zero by itself, and a
place further along the same hall is no ambiguity.
Assumes that both sets are rigid: a few metres of driving each.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
from scipy.spatial import cKDTree

from common.geometry import FloatArray, Points, Pose2
from onboard.mmu.front_end.correlative_search import Place, search

# Tuned on recorded robots (range logs) and simulated ones; the sensitivity was not measured
NEIGHBOUR_M = 0.30
NEIGHBOUR_FINAL_M = 0.15
NORMALS_COS_MIN = 0.85
POINT_SD_M = 0.03
POINTS_PER_INDEPENDENT = 6.0  # neighbouring echoes share their errors
ITERATIONS = 10
PARTNERS_MIN = 8
NORMAL_SD_RAD = radians(5.0)
PIECE_STEP_M = 0.1
PIECE_HALF_MAX_M = 0.5
PIECE_PERCENTILE = 75  # of the distances from echo to echo: pieces of wall as long as these close most gaps
SECOND_BEST_M = 0.5  # how far the second-best place lies from the best one at least
SECOND_BEST_CHI2 = 50.0  # squared Mahalanobis distance, likewise: along a bare hall it stays small


@dataclass(frozen=True, slots=True)
class Match:
    """`correction` brings the moving points (given in the map as estimated) onto the fixed ones."""

    correction: Pose2
    information: FloatArray  # (3, 3) of the correction, about the centre given to `register`
    overlap: float  # share of the moving points that found a partner
    rms_m: float
    score: float = 0.0  # of the coarse search; 0 where nothing was searched
    ambiguity: float = 0.0  # score of the second-best place over that of the best


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

    Returns None where too few points find a partner.
    """
    local = points - centre
    fixed, fixed_normals = _as_pieces(fixed_points - centre, fixed_normals)
    start = np.zeros(3)
    places: list[Place] = []
    if search_m > 0:
        angles = (np.arctan2(n[:, 1], n[:, 0]) for n in (normals, fixed_normals))
        places = search(local, next(angles), fixed, next(angles), search_m, search_rad)
        if not places:
            return None
        start = np.array([places[0].x_m, places[0].y_m, places[0].turn_rad])
    fit = _align(local, normals, fixed, fixed_normals, start)
    if fit is None:
        return None
    correction, hessian, overlap, rms_m = fit
    partners = round(overlap * len(points))
    information = _without_scatter(hessian, partners) / (POINT_SD_M**2 * POINTS_PER_INDEPENDENT)
    score = places[0].score if places else 0.0
    second_best = max((p.score for p in places[1:] if _elsewhere(p, places[0], information)), default=0.0)
    return Match(Pose2.from_array(correction), information, overlap, rms_m, score, second_best / max(score, 1e-9))


def _as_pieces(points: Points, normals: Points) -> tuple[Points, Points]:
    """Where echoes lie far apart, each stands for a piece of wall half way to the next: points along it.

    Otherwise an echo of another pass, which met the wall between two of them, would find no partner.
    """
    if len(points) < 2:
        return points, normals
    apart_m = np.asarray(cKDTree(points).query(points, k=2)[0])
    half_m = min(0.5 * float(np.percentile(apart_m[:, 1], PIECE_PERCENTILE)), PIECE_HALF_MAX_M)
    reach = int(half_m / PIECE_STEP_M)
    if reach == 0:
        return points, normals
    along_m = PIECE_STEP_M * np.arange(-reach, reach + 1)
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    pieces = points[:, None, :] + along_m[None, :, None] * tangents[:, None, :]
    return pieces.reshape(-1, 2), np.repeat(normals, len(along_m), axis=0)


def _align(
    points: Points, normals: Points, fixed: Points, fixed_normals: Points, correction: FloatArray
) -> tuple[FloatArray, FloatArray, float, float] | None:
    """Point-to-line least squares from a first correction (3,) on.

    Correction (3,), its Hessian (3, 3), share of the points that found a partner, and RMS of their distances (m).
    """
    tree = cKDTree(fixed)
    for iteration in range(ITERATIONS):
        moved, turned = _move(correction, points, normals)
        gate_m = max(NEIGHBOUR_M * 0.7**iteration, NEIGHBOUR_FINAL_M)
        distance_m, index = tree.query(moved, distance_upper_bound=gate_m)
        used = np.isfinite(distance_m)
        index = np.where(used, index, 0)
        used &= (turned * fixed_normals[index]).sum(axis=1) > NORMALS_COS_MIN
        if used.sum() < PARTNERS_MIN:
            return None
        p, n = moved[used], fixed_normals[index[used]]
        residual = ((p - fixed[index[used]]) * n).sum(axis=1)
        weight = 1.0 / (1.0 + (residual / (2 * POINT_SD_M)) ** 2)
        jacobian = np.stack([n[:, 0], n[:, 1], p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0]], axis=1)
        hessian = (jacobian * weight[:, None]).T @ jacobian
        step = np.linalg.solve(hessian + np.diag([0.5, 0.5, 0.5]), (jacobian * weight[:, None]).T @ residual)
        correction = _compose(-step, correction)
        if abs(step[:2]).max() < 1e-3 and abs(step[2]) < 1e-4 and gate_m == NEIGHBOUR_FINAL_M:
            break
    rms_m = float(np.sqrt((weight * residual**2).sum() / weight.sum()))
    return correction, hessian, float(used.mean()), rms_m


def _without_scatter(hessian: FloatArray, count: int) -> FloatArray:
    """(3, 3): normals of `count` points scatter, and what they seem to measure along a bare wall is noise."""
    out = np.zeros((3, 3))
    values, vectors = np.linalg.eigh(hessian[:2, :2])
    values = np.maximum(values - count * NORMAL_SD_RAD**2, 1e-3)
    out[:2, :2] = (vectors * values) @ vectors.T
    out[2, 2] = hessian[2, 2]
    return out


def _elsewhere(place: Place, best: Place, information: FloatArray) -> bool:
    """Another solution, and not the same one along a direction that the walls leave open."""
    shift = np.array([place.x_m - best.x_m, place.y_m - best.y_m])
    far = float(shift @ shift) > SECOND_BEST_M**2
    return far and float(shift @ information[:2, :2] @ shift) > SECOND_BEST_CHI2


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
