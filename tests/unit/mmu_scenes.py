"""Sonars between straight walls, as simple as can be: what a mapping unit receives."""

from __future__ import annotations

from math import atan2, hypot, inf, nan, radians

import numpy as np

from common.constants import SONAR_BEARINGS_RAD, SONAR_MAX_M, SONAR_STEP_M
from common.geometry import FloatArray, Pose2, wrap_angle

BEAM_HALF_RAD = radians(32.0)

Wall = tuple[float, float, float, float]  # from x, y to x, y; metres


def ring(x0: float, y0: float, x1: float, y1: float) -> list[Wall]:
    """The four walls of a room, or of an island."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return [(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def ranges_to(pose: Pose2, walls: FloatArray) -> tuple[float, ...]:
    """What five sonars measure of walls (N, 4): the nearest foot within each beam, in whole steps; NaN = nothing."""
    a, d = walls[:, :2], walls[:, 2:] - walls[:, :2]
    at = np.array([pose.x_m, pose.y_m])
    share = ((at - a) * d).sum(axis=1) / (d * d).sum(axis=1)
    feet = [tuple(foot) for foot in (a + share[:, None] * d)[(share >= 0.0) & (share <= 1.0)]]
    ranges = []
    for bearing_rad in SONAR_BEARINGS_RAD:
        distances = [
            hypot(x - pose.x_m, y - pose.y_m)
            for x, y in feet
            if abs(wrap_angle(atan2(y - pose.y_m, x - pose.x_m) - pose.heading_rad - bearing_rad)) < BEAM_HALF_RAD
        ]
        nearest_m = min(distances, default=inf)
        ranges.append(nearest_m // SONAR_STEP_M * SONAR_STEP_M if nearest_m < SONAR_MAX_M else nan)
    return tuple(ranges)
