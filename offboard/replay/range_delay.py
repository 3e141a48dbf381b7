"""How old the ranges of a log are against its odometry -> seconds, or 0 where the log does not show it.

A driver stamps scan and odometry when they arrive. Where scans were under way for longer, each is paired with odometry
from after it, and a robot that turns by 40 degrees a second seems to see the walls 6 degrees beside where they stand
0.15 s later. Walls along which it drives straight stay, so what one beam saw lies off what another saw before the turn.

The delay is the one with which different beams see the same walls. Each of several pieces of the log measures it: they
must agree far better than by chance.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import numpy as np
from scipy.spatial import cKDTree

from common.geometry import FloatArray, Points

DELAYS_S = np.linspace(-0.3, 0.3, 13)
PIECES = 6  # of the log, with as much turning in each
SIGMAS_MIN = 6.0  # of the mean over the pieces: chance does that in two of a thousand logs
PIECE_SD_MIN_S = 0.0145  # what steps of 0.05 s leave open
FRAMES_MIN = 40
STEP_M, STEP_RAD = 0.04, 0.03  # a frame that differs by less from the one before shows nothing new
WALL_MIN_M, WALL_MAX_M = 0.03, 0.5  # two neighbouring places seen by a beam are a wall
GRAZING_COS = 0.35
TOGETHER_M = 3.0  # of path: odometry is right for so long
NEAR_M = 0.5
BESIDE_M = 0.05  # beyond the ends of a wall
OFF_MAX_M = 0.15
PLACES_MIN = 100


def range_delay_s(times_s: FloatArray, poses: FloatArray, ranges_m: FloatArray, bearings_rad: FloatArray) -> float:
    """Of odometry `poses` (N, 3) and `ranges_m` (N, beams) with the same `times_s` (N,); positive: ranges are older."""
    turned_rad = np.append(0.0, np.abs(np.diff(np.unwrap(poses[:, 2]))).cumsum())
    ends = np.searchsorted(turned_rad, np.linspace(0.0, turned_rad[-1], PIECES + 1))
    measured_s = []
    for start, end in pairwise(ends.tolist()):
        own = slice(start, end)
        if end - start >= FRAMES_MIN:
            off_m = [_off_m(poses_at(times_s[own], poses[own], d), ranges_m[own], bearings_rad) for d in DELAYS_S]
            if np.isfinite(off_m).all():
                measured_s.append(_lowest_s(np.array(off_m)))
    if len(measured_s) < PIECES - 1:
        return 0.0
    sd_s = max(float(np.std(measured_s, ddof=1)), PIECE_SD_MIN_S) / sqrt(len(measured_s))
    mean_s = float(np.mean(measured_s))
    return mean_s if abs(mean_s) > SIGMAS_MIN * sd_s else 0.0


def poses_at(times_s: FloatArray, poses: FloatArray, delay_s: float) -> FloatArray:
    """Where odometry `poses` (N, 3) lay so much earlier, headings not wrapped."""
    earlier_s = times_s - delay_s
    columns = poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(earlier_s, times_s, column) for column in columns])


def _lowest_s(off_m: FloatArray) -> float:
    """Where a parabola through the lowest and its neighbours is lowest."""
    k = int(off_m.argmin())
    if not 0 < k < len(off_m) - 1:
        return float(DELAYS_S[k])
    before, here, after = off_m[k - 1 : k + 2].tolist()
    share = 0.5 * (before - after) / max(before - 2 * here + after, 1e-12)
    return float(DELAYS_S[k] + share * (DELAYS_S[1] - DELAYS_S[0]))


def _off_m(poses: FloatArray, ranges_m: FloatArray, bearings_rad: FloatArray) -> float:
    """How far places that one beam saw lie off the walls that others saw, on average; NaN where too few do."""
    new = _moved(poses)
    poses, ranges_m = poses[new], ranges_m[new]
    path_m = np.append(0.0, np.hypot(*np.diff(poses[:, :2], axis=0).T).cumsum()) * NEAR_M / TOGETHER_M
    direction_rad = poses[:, 2:] + bearings_rad
    away = ranges_m[:, :, None] * np.stack([np.cos(direction_rad), np.sin(direction_rad)], axis=2)
    places = poses[:, None, :2] + away
    off_m: list[FloatArray] = []
    for beam in range(len(bearings_rad)):
        middles, normals, halves_m, walls = _walls(places[:, beam], away[:, beam])
        if not len(walls):
            continue
        tree = cKDTree(np.column_stack([middles, path_m[walls]]))
        theirs = np.delete(places, beam, axis=1)
        seen = np.isfinite(theirs[:, :, 0])
        theirs, paths_m = theirs[seen], np.broadcast_to(path_m[:, None], seen.shape)[seen]
        distance_m, index = tree.query(np.column_stack([theirs, paths_m]), distance_upper_bound=NEAR_M)
        found = np.isfinite(distance_m)
        index = np.asarray(index)[found]
        to = theirs[found] - middles[index]
        across_m = np.abs((to * normals[index]).sum(axis=1))
        along_m = np.abs(to[:, 1] * normals[index, 0] - to[:, 0] * normals[index, 1])
        off_m.append(across_m[along_m < halves_m[index] + BESIDE_M])
    all_m = np.concatenate(off_m) if off_m else np.zeros(0)
    return float(np.minimum(all_m, OFF_MAX_M).mean()) if len(all_m) >= PLACES_MIN else float("nan")


def _moved(poses: FloatArray) -> list[int]:
    """Frames that show something new."""
    new = [0]
    for i in range(1, len(poses)):
        step = poses[i] - poses[new[-1]]
        if np.hypot(step[0], step[1]) > STEP_M or abs(step[2]) > STEP_RAD:
            new.append(i)
    return new


def _walls(places: Points, away: Points) -> tuple[Points, Points, FloatArray, FloatArray]:
    """Between neighbouring places (N, 2) of one beam: middles, unit normals, half lengths, and which of N each is."""
    along = np.diff(places, axis=0)
    length_m = np.hypot(along[:, 0], along[:, 1])
    walls = np.flatnonzero((length_m > WALL_MIN_M) & (length_m < WALL_MAX_M))
    normals = np.column_stack([-along[walls, 1], along[walls, 0]]) / length_m[walls, None]
    cosines = np.abs((away[walls] * normals).sum(axis=1)) / np.hypot(away[walls, 0], away[walls, 1])
    met = cosines > GRAZING_COS
    walls = walls[met]
    return (places[walls] + places[walls + 1]) / 2, normals[met], length_m[walls] / 2, walls
