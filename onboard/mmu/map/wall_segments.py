"""Straight segments of wall through the echoes of the map, and the corners between them, from which no echo comes.

A wall echoes at the foot of the perpendicular, so in a corner that the robot cannot drive into neither wall echoes up
to its end. Two straight walls that both end there and face each other meet; their rest is inferred.

1. Echoes that measure the same are merged; the heaviest left seeds a line, which grows as long as neighbours lie on
   it and face alike (total least squares, weighted by how many echoes there are).
2. Ends of two walls within GAP_MAX_M of where their lines meet are a corner, the nearest ones first, unless rays went
   through: then it is the mouth of a hall.
3. Both walls are filled up to the corner, and wherever their own echoes are further apart than the map may be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import asin, cos, radians, sin

import numpy as np
import numpy.typing as npt

from common.constants import MAP_DENSITY_PER_M
from common.geometry import FloatArray, Points

# Straight segments. The sensitivity was not measured
CELL_M = 0.05  # echoes in one cell that face alike count as one
SECTORS = 16
INLIER_M = 0.06
SEED_INLIER_M = 0.12  # while the direction is known from one normal only
REACHES_M = (0.75, 3.0)  # to each side of the seed, before the whole wall
FACING_COS_MIN = float(np.cos(radians(20.0)))
NEIGHBOUR_M = 0.35  # echoes further apart are no longer one wall: nothing that a robot fits through is narrower
LENGTH_MIN_M = 0.4
CELLS_MIN = 5
END_M = 2.0  # of a wall: what shows where it continues

# Corners between them: what counts as one, and how many rays prove an opening. The sensitivity was not measured
GAP_MAX_M = 1.3
OVERSHOOT_M = 0.25  # a wall may seem to end that much behind the corner
DIRECTION_SD_RAD_M = 0.05  # of a wall's direction, times its length: echoes near its end lie off, all to one side
SQUARE_SD_RAD = radians(2.0)
SQUARE_NEAR_RAD = radians(12.0)
CORNER_COS_MAX = float(np.cos(radians(35.0)))
STEP_M = 0.8 / MAP_DENSITY_PER_M
SILENT_FREE_M = 1.0  # a wall this near would have echoed at least once
RAY_MARGIN_M = 0.15
SUPPORT = 3  # echoes close together on each side of a gap: one alone may lie beside the wall's end
RAYS_MAX = 3  # through a wall: more are no accident
SQUARE_COS_MIN = float(np.cos(radians(30.0)))  # a ray that meets a wall less squarely may have been reflected away
RAY_REACH_M = 4.0

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class WallSegment:
    """A straight wall from `low` to `high`, (2,) each; `normal` points away from the robot, `along` to `high`."""

    low: FloatArray
    high: FloatArray
    normal: FloatArray
    along: FloatArray
    members: Points  # (N, 2), sorted along the wall

    def end(self, high: bool) -> End:
        """By its last metres."""
        corner, out = (self.high, self.along) if high else (self.low, -self.along)
        near = self.members[np.abs((self.members - corner) @ self.along) <= END_M]
        middle, normal = (self.low + self.high) / 2, self.normal
        if len(near) >= CELLS_MIN:
            middle, normal = _line(near, np.ones(len(near)), self.normal)
        outward = np.array([-normal[1], normal[0]])
        outward = outward if outward @ out > 0 else -outward
        reach_m = float((corner - middle) @ outward)
        return End(middle, outward, normal, reach_m, DIRECTION_SD_RAD_M / max(2 * reach_m, LENGTH_MIN_M))


@dataclass(frozen=True, slots=True)
class End:
    """Of a wall: it goes through `middle` along `out`, as far as `reach_m`; how well its direction is known."""

    middle: FloatArray
    out: FloatArray
    normal: FloatArray
    reach_m: float
    direction_sd_rad: float

    @property
    def at(self) -> FloatArray:
        place: FloatArray = self.middle + self.reach_m * self.out
        return place

    def turned(self, by_rad: float) -> End:
        """About its middle."""
        c, s = cos(by_rad), sin(by_rad)
        turn = np.array([[c, -s], [s, c]])
        return replace(self, out=turn @ self.out, normal=turn @ self.normal)


class Rays:
    """Space that was observed to be free: from (R, 2) along (R,) so far (R,), infinite where no echo came."""

    def __init__(self, starts: Points, directions_rad: FloatArray, free_m: FloatArray) -> None:
        self._starts = starts
        self._unit = np.column_stack([np.cos(directions_rad), np.sin(directions_rad)])
        self._free_m = np.where(np.isfinite(free_m), free_m - RAY_MARGIN_M, SILENT_FREE_M)

    def pass_through(self, a: FloatArray, b: FloatArray) -> bool:
        """So many went through the straight line from `a` to `b` that there is no wall."""
        near = (np.abs(self._starts - a) < RAY_REACH_M).all(axis=1)
        start, unit, free_m = self._starts[near] - a, self._unit[near], self._free_m[near]
        span = b - a
        # start + t * unit = s * span
        turn = unit[:, 0] * span[1] - unit[:, 1] * span[0]
        turn = np.where(np.abs(turn) < 1e-9, 1e-9, turn)
        t = (start[:, 1] * span[0] - start[:, 0] * span[1]) / turn
        s = (start[:, 1] * unit[:, 0] - start[:, 0] * unit[:, 1]) / turn
        square = np.abs(turn) > SQUARE_COS_MIN * float(np.hypot(*span))
        return int((square & (t > 0) & (t < free_m) & (s > 0) & (s < 1)).sum()) > RAYS_MAX


def inferred_points(echoes: Points, normals_rad: FloatArray, rays: Rays) -> Points:
    """Wall points (M, 2) that nothing echoed from; echoes (N, 2), normals (N,) of their walls, away from the robot."""
    walls = straight_walls(echoes, normals_rad)
    pieces = [piece for wall in walls for piece in _gaps(wall)]
    pieces += [piece for corner in corners(walls, rays) for piece in corner]
    return np.concatenate([np.zeros((0, 2)), *(_filled(a, b) for a, b in pieces)])


def straight_walls(points: Points, normals_rad: FloatArray) -> list[WallSegment]:
    """The longest runs of echoes (N, 2) with normals (N,) that lie on one line."""
    p, n, weight = _thinned(points, normals_rad)
    free: Mask = np.ones(len(p), dtype=np.bool_)
    walls: list[WallSegment] = []
    for seed in np.argsort(-weight, kind="stable").tolist():
        if not free[seed]:
            continue
        members = _grown(p, n, weight, free, seed)
        free[seed] = False
        if members is None:
            continue
        free[members] = False
        middle, normal = _line(p[members], weight[members], n[seed])
        along = np.array([-normal[1], normal[0]])
        share = (p[members] - middle) @ along
        if np.ptp(share) >= LENGTH_MIN_M:
            low, high = middle + share.min() * along, middle + share.max() * along
            walls.append(WallSegment(low, high, normal, along, p[members][np.argsort(share)]))
    return walls


def _thinned(points: Points, normals_rad: FloatArray) -> tuple[Points, Points, FloatArray]:
    """One point, one unit normal and a weight for each cell and direction that echoes come from."""
    if not len(points):
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    sector = np.round(normals_rad * (SECTORS / (2 * np.pi))) % SECTORS
    key = np.column_stack([np.floor(points / CELL_M), sector]).astype(np.int64)
    _, cell, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)  # numpy 2.0 alone gives it another shape
    columns = points[:, 0], points[:, 1], np.cos(normals_rad), np.sin(normals_rad)
    means = np.column_stack([np.bincount(cell, column) / count for column in columns])
    length = np.maximum(np.hypot(means[:, 2], means[:, 3]), 1e-9)
    return means[:, :2], means[:, 2:] / length[:, None], count.astype(np.float64)


def _grown(p: Points, n: Points, weight: FloatArray, free: Mask, seed: int) -> npt.NDArray[np.int64] | None:
    """The points of the wall that the seed lies on; None where there is none."""
    middle, normal = p[seed], n[seed]
    for reach_m, inlier_m in (*zip(REACHES_M, (SEED_INLIER_M, INLIER_M), strict=True), (np.inf, INLIER_M)):
        offset = p - middle
        along = offset @ np.array([-normal[1], normal[0]])
        on_line = (
            free & (np.abs(offset @ normal) < inlier_m) & (np.abs(along) < reach_m) & (n @ normal > FACING_COS_MIN)
        )
        members = np.flatnonzero(on_line)
        if len(members) < CELLS_MIN:
            return None
        if reach_m == np.inf:
            members = _contiguous(members, along[members], along[seed])
            return members if len(members) >= CELLS_MIN else None
        middle, normal = _line(p[members], weight[members], normal)
    return None


def _contiguous(members: npt.NDArray[np.int64], along: FloatArray, at: float) -> npt.NDArray[np.int64]:
    """Those of the run without gaps that holds the place `at`."""
    order = np.argsort(along, kind="stable")
    runs = np.concatenate([[0], np.cumsum(np.diff(along[order]) > NEIGHBOUR_M)])
    run = runs[np.abs(along[order] - at).argmin()]
    contiguous: npt.NDArray[np.int64] = members[order[runs == run]]
    return contiguous


def _line(p: Points, weight: FloatArray, facing: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle (2,) and unit normal (2,) on the side of `facing`."""
    middle = weight @ p / weight.sum()
    offset = p - middle
    _, vectors = np.linalg.eigh((offset * weight[:, None]).T @ offset)
    normal = vectors[:, 0]
    return middle, normal if normal @ facing > 0 else -normal


def corners(walls: list[WallSegment], rays: Rays) -> list[list[tuple[FloatArray, FloatArray]]]:
    """For each corner the pieces (from, to) that lead to it."""
    ends = [(i, wall.end(high)) for i, wall in enumerate(walls) for high in (False, True)]
    if len(ends) < 2:
        return []
    places = np.array([end.at for _, end in ends])
    apart = places[:, None] - places[None, :]
    pairs = np.argwhere(np.triu((np.abs(apart) < 2 * GAP_MAX_M).all(axis=2), 1)).tolist()
    found = [
        (gap_m, a, b, legs)
        for a, b in pairs
        if ends[a][0] != ends[b][0] and (met := _meet(*_squared(ends[a][1], ends[b][1]))) is not None
        for gap_m, legs in [met]
    ]
    closed: set[int] = set()
    out: list[list[tuple[FloatArray, FloatArray]]] = []
    for _, a, b, legs in sorted(found, key=lambda corner: corner[:3]):
        if closed & {a, b} or any(rays.pass_through(*leg) for leg in legs):
            continue
        closed |= {a, b}
        out.append([(start, to) for start, to in legs if float(np.hypot(*(to - start))) > STEP_M])
    return out


def _squared(a: End, b: End) -> tuple[End, End]:
    """Walls nearly at a right angle are turned towards it, the more, the less their own directions are known."""
    off_rad = asin(max(-1.0, min(1.0, float(a.out @ b.out))))
    if abs(off_rad) > SQUARE_NEAR_RAD:
        return a, b
    total = a.direction_sd_rad**2 + b.direction_sd_rad**2 + SQUARE_SD_RAD**2
    side = 1.0 if a.out[0] * b.out[1] - a.out[1] * b.out[0] > 0 else -1.0
    return (
        a.turned(-side * off_rad * a.direction_sd_rad**2 / total),
        b.turned(side * off_rad * b.direction_sd_rad**2 / total),
    )


def _meet(a: End, b: End) -> tuple[float, list[tuple[FloatArray, FloatArray]]] | None:
    """The gap before the inner corner that two walls form, and the pieces up to it; None where they form none."""
    if abs(float(a.normal @ b.normal)) > CORNER_COS_MAX:
        return None
    gap_a, gap_b = np.linalg.solve(np.column_stack([a.out, -b.out]), b.at - a.at).tolist()
    inner = a.out @ b.normal > 0 and b.out @ a.normal > 0
    if not inner or min(gap_a, gap_b) < -OVERSHOOT_M or max(gap_a, gap_b) > GAP_MAX_M:
        return None
    corner = a.at + gap_a * a.out
    legs = [(end.at, corner) for end, gap_m in ((a, gap_a), (b, gap_b)) if gap_m > 0]
    return max(gap_a, 0.0) + max(gap_b, 0.0), legs


def _gaps(wall: WallSegment) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Pieces (from, to) of a wall from which no echo came."""
    share = wall.members @ wall.along
    for i in np.flatnonzero(np.diff(share) > 1.0 / MAP_DENSITY_PER_M).tolist():
        before = share[max(i - SUPPORT + 1, 0) : i + 1]
        after = share[i + 1 : i + 1 + SUPPORT]
        if all(len(side) == SUPPORT and np.ptp(side) < NEIGHBOUR_M for side in (before, after)):
            yield wall.members[i], wall.members[i + 1]


def _filled(a: FloatArray, b: FloatArray) -> Points:
    """Points (N, 2) between two places, the second one included."""
    count = max(int(np.ceil(float(np.hypot(*(b - a))) / STEP_M)), 1)
    return a + (b - a) * (np.arange(1, count + 1) / count)[:, None]
