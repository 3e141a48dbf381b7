"""The wall points that the mapping unit publishes: does a wall lie between two points, and where does it face?

A candidate for a door without a wall behind it is the mouth of a side hall.
"""

from __future__ import annotations

from math import cos, pi

import numpy as np

from common.geometry import Points, Pose2, principal_axis, wrap_angle
from common.messages.mapping import MapUpdate
from common.wall_points import WallPointMap
from onboard.poi.placement.wall_line import WallPoint

BACKING_M = 0.20  # a door may stand back from its wall, and the map errs
SAMPLES = 5  # places on the line between two edges
BACKED_SHARE = 0.8  # of the samples within BACKING_M of a wall point
INNER = 0.7  # share of the line that is sampled: the corners of a mouth give echoes at its ends
NEAR_M = 0.7  # radius of the wall points that give a normal
POINTS_MIN = 5  # among them
PATH_CLEAR_M, GOAL_CLEAR_M = 0.25, 0.45  # free of wall points beside the line, and around its end
RAY_M = 0.08  # from a ray, for wall that it meets
BEFORE_M = 0.4  # nearer to its end than this, wall is the one that the point is on
HIDING_MIN = 3  # wall points; a single one may be a person
STRAIGHT = 0.25  # spread across over spread along: more is a corner


class WallMap:
    """All points known now."""

    def __init__(self) -> None:
        self._points = WallPointMap()

    def add(self, update: MapUpdate) -> None:
        self._points.apply(update)

    def backs(self, left: WallPoint, right: WallPoint) -> bool:
        """Whether at least BACKED_SHARE of the line between two points lies on mapped wall."""
        a, b = np.array([left.x_m, left.y_m]), np.array([right.x_m, right.y_m])
        middle, half = (a + b) / 2, (b - a) / 2 * INNER
        reach_m = float(np.hypot(*half)) + BACKING_M
        near = self._near(middle, reach_m)
        if not len(near):
            return False
        samples = middle + np.linspace(-1.0, 1.0, SAMPLES)[:, None] * half
        gaps_m = np.hypot(*(samples[:, None] - near[None]).transpose(2, 0, 1)).min(axis=1)
        return bool((gaps_m < BACKING_M).mean() >= BACKED_SHARE)

    def in_sight(self, from_pose: Pose2, to_pose: Pose2) -> bool:
        """Whether no mapped wall stands between two poses, nor too near to their straight line or to the second one."""
        a, b = np.array([from_pose.x_m, from_pose.y_m]), np.array([to_pose.x_m, to_pose.y_m])
        length_m = float(np.hypot(*(b - a)))
        near = self._near((a + b) / 2, length_m / 2 + PATH_CLEAR_M)
        if not len(near) or length_m < 1e-6:
            return True
        if np.hypot(*(near - b).T).min() < GOAL_CLEAR_M:
            return False
        share = np.clip((near - a) @ (b - a) / length_m**2, 0.0, 1.0)
        return bool((np.hypot(*(near - a - share[:, None] * (b - a)).T) > PATH_CLEAR_M).all())

    def hides(self, point: WallPoint, pose: Pose2) -> bool:
        """Whether mapped wall stands between a pose and a point on a wall: then what is in sight hangs on that."""
        a, b = np.array([pose.x_m, pose.y_m]), np.array([point.x_m, point.y_m])
        length_m = float(np.hypot(*(b - a)))
        if length_m <= BEFORE_M:
            return False
        along = (b - a) / length_m
        near = self._near((a + b) / 2, length_m / 2) - a
        forward_m, aside_m = near @ along, near @ np.array([-along[1], along[0]])
        between = (np.abs(aside_m) < RAY_M) & (forward_m > 0.0) & (forward_m < length_m - BEFORE_M)
        return int(between.sum()) >= HIDING_MIN

    def facing(self, point: WallPoint) -> WallPoint:
        """The point with the direction out of the mapped wall around it; as it is where the map shows no plain wall."""
        normal_rad = self.normal_rad(point)
        return point if normal_rad is None else WallPoint(point.x_m, point.y_m, normal_rad)

    def normal_rad(self, point: WallPoint) -> float | None:
        """Direction out of the mapped wall around a point, on its own side; None where there is no plain wall."""
        near = self._near(np.array([point.x_m, point.y_m]), NEAR_M)
        if len(near) < POINTS_MIN:
            return None
        direction_rad, across, along = principal_axis(near)
        if across > STRAIGHT**2 * along:
            return None
        normal_rad = direction_rad + pi / 2
        if cos(normal_rad - point.normal_rad) < 0:
            normal_rad += pi
        return wrap_angle(normal_rad)

    def _near(self, middle: Points, reach_m: float) -> Points:
        p = self._points.near(float(middle[0]), float(middle[1]), reach_m)
        near: Points = p[np.hypot(p[:, 0] - middle[0], p[:, 1] - middle[1]) < reach_m]
        return near
