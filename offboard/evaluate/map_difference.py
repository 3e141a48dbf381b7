"""Two recorded runs of one floor over each other: both maps -> how they lie on each other, and walls that differ.

Maps of runs that began at one place lie over each other but for the error of their first headings. That is taken out by
iterated closest points, each drawn to the line of the other map's wall there (Chen and Medioni 1992).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, hypot

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from common.geometry import FloatArray, Points, Pose2
from offboard.export.occupancy_image import CELL_M, UNKNOWN, OccupancyImage

TOLERANCE_M = 0.25  # walls that are nearer to each other are one: both maps are right to some centimetres
REACHES_M = (0.8,) * 8 + (0.4,) * 8  # of pairs, from the first round on; the result hardly depends on it
NEIGHBOURS = 8  # of a point, whose line gives the wall's direction there
POINTS_MAX = 4000  # of either map, for the fit

Seen = Callable[[Points], npt.NDArray[np.bool_]]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class MapDifference:
    """Walls (N, 2) in this map's frame. What only one of them holds, though the other one saw the place, is a
    difference; what the other one did not see is none."""

    placed: Pose2  # where the other map's start lies in this map
    common_m: Points
    only_here_m: Points
    only_there_m: Points
    unseen_m: Points  # of either map

    @property
    def agreement(self) -> float:
        """Share of the walls at places that both saw which both hold."""
        differing = len(self.only_here_m) + len(self.only_there_m)
        return len(self.common_m) / max(1, len(self.common_m) + differing)

    def as_text(self) -> str:
        shift_m = hypot(self.placed.x_m, self.placed.y_m)
        turn = f"{abs(degrees(self.placed.heading_rad)):.1f}°"
        return f"{100 * self.agreement:.0f} % of the walls that both saw agree; moved {shift_m:.2f} m, turned {turn}"


def seen_of(image: OccupancyImage) -> Seen:
    """Of places (N, 2): whether that run knows what is there, or within a cell of it."""
    rows, columns = image.cells.shape
    known = np.pad(image.cells[::-1] != UNKNOWN, 1)
    near = np.zeros((rows, columns), bool)
    for i in range(3):
        for j in range(3):
            near |= known[i : i + rows, j : j + columns]

    def seen(places_m: Points) -> Mask:
        column, row = np.floor((places_m - (image.origin_x_m, image.origin_y_m)) / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        found = np.zeros(len(places_m), bool)
        found[inside] = near[row[inside], column[inside]]
        return found

    return seen


def map_difference(here_m: Points, there_m: Points, seen_here: Seen, seen_there: Seen) -> MapDifference:
    """Walls of both maps (N, 2) in their own frames, and what each run knows, by places in its own frame."""
    if not len(here_m) or not len(there_m):
        unseen_m = np.concatenate([here_m, there_m]).reshape(-1, 2)
        nothing = np.empty((0, 2))
        return MapDifference(Pose2(0.0, 0.0, 0.0), nothing, nothing, nothing, unseen_m)
    placed = fitted(here_m, there_m)
    moved_m = placed.transform(there_m)
    in_both_here = _near(here_m, moved_m)
    in_both_there = _near(moved_m, here_m)
    known_there = seen_there(placed.inverse().transform(here_m))
    known_here = seen_here(moved_m)
    unseen_m = np.concatenate([here_m[~in_both_here & ~known_there], moved_m[~in_both_there & ~known_here]])
    return MapDifference(
        placed,
        here_m[in_both_here],
        here_m[~in_both_here & known_there],
        moved_m[~in_both_there & known_here],
        unseen_m,
    )


def fitted(here_m: Points, there_m: Points) -> Pose2:
    """The rigid motion that lays `there_m` onto `here_m`, from no motion on."""
    here_m, there_m = _some(here_m), _some(there_m)
    tree = cKDTree(here_m)
    normals = _normals(here_m, tree)
    placed = Pose2(0.0, 0.0, 0.0)
    for reach_m in REACHES_M:
        moved_m = placed.transform(there_m)
        distance_m, nearest = tree.query(moved_m)
        paired = distance_m < reach_m
        if np.count_nonzero(paired) < NEIGHBOURS:
            break
        pairs = np.asarray(nearest)[paired]
        placed = _step(moved_m[paired], here_m[pairs], normals[pairs]).compose(placed)
    return placed


def _step(moved_m: Points, onto_m: Points, normals: FloatArray) -> Pose2:
    """The small motion that brings points (N, 2) nearest to lines through `onto_m` across `normals` (N, 2)."""
    off_m = np.einsum("ij,ij->i", onto_m - moved_m, normals)
    turning = normals[:, 1] * moved_m[:, 0] - normals[:, 0] * moved_m[:, 1]
    x_m, y_m, turn_rad = np.linalg.lstsq(np.column_stack([normals, turning]), off_m, rcond=None)[0].tolist()
    return Pose2(x_m, y_m, turn_rad)


def _normals(points_m: Points, tree: cKDTree) -> FloatArray:
    """(N, 2) across the wall at each point: the axis along which its neighbours differ least."""
    _, near = tree.query(points_m, k=min(NEIGHBOURS, len(points_m)))
    groups = points_m[np.asarray(near).reshape(len(points_m), -1)]
    centred = groups - groups.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    return np.asarray(axes[:, :, 0])


def _some(points_m: Points) -> Points:
    return points_m[:: -(-len(points_m) // POINTS_MAX)]


def _near(points_m: Points, others_m: Points) -> Mask:
    distance_m, _ = cKDTree(others_m).query(points_m, distance_upper_bound=TOLERANCE_M)
    return np.asarray(np.isfinite(distance_m))
