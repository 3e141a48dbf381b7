"""Heading drift measured by walls: if walls seem to turn as the robot drives along them, odometry's heading drifts.

The direction in which one thing echoes stays while a robot drives past straight walls, whatever their directions are.
Corners and door jambs turn, but those on the left against those on the right.
"""

from __future__ import annotations

from math import radians

import numpy as np

from common.geometry import FloatArray, wrap_angles

# The sensitivity to these was not measured
APART_MIN_M = 0.3
SAME_WALL_RAD = radians(25.0)  # what differs by more was another wall
ECHOES_MAX = 200
PAIRS_MIN = 300


def apparent_turn(paths_m: FloatArray, normals_rad: FloatArray) -> float | None:
    """By how much walls seem to turn per metre (rad/m), from the normals (N,) of echoes received at `paths_m` (N,).

    Least squares over all pairs that may be of one wall; None where there are too few. To be given a few metres.
    """
    stride = max(1, -(-len(paths_m) // ECHOES_MAX))
    paths_m, normals_rad = paths_m[::stride], normals_rad[::stride]
    first, second = np.triu_indices(len(paths_m), 1)
    apart_m = paths_m[second] - paths_m[first]
    turned_rad = wrap_angles(normals_rad[second] - normals_rad[first])
    pairs = (apart_m > APART_MIN_M) & (np.abs(turned_rad) < SAME_WALL_RAD)
    if pairs.sum() < PAIRS_MIN:
        return None
    return float((turned_rad * apart_m)[pairs].sum() / (apart_m[pairs] ** 2).sum())
