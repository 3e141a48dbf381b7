"""Points on the wall: echoes of the right sonar and a bearing of the camera in, a point of the map out.

A sonar measures the perpendicular distance of a smooth wall: while the robot drives straight, the feet of the right
sonar's echoes lie on the wall. The line through the newest ones is the wall on the right; a sign stands where the ray
of its column meets that line.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import cos, hypot, isnan, pi, sin

import numpy as np

from common.geometry import Pose2, principal_axis, wrap_angle

WALL_REACH_M = 2.6  # from further away poi reads nothing
ALONG_M = 1.2  # echoes this near to the newest belong to the same piece of wall
STEP_MAX_M = 0.12  # off the line: another wall
SKEW_MAX_RAD = 0.25  # a wall that stands more across than this is not the one that the robot drives along
ROUGH_MAX_M = 0.035  # standard deviation off the line; rougher feet lie on several walls
FEET_KEPT = 120
FEET_MIN = 4  # for a wall line
SPREAD_MIN_M = 0.25  # shorter pieces give no direction
INCIDENCE_MAX_RAD = 0.9  # a flatter ray places a sign too inexactly


@dataclass(frozen=True, slots=True)
class WallPoint:
    """A point on a wall and the direction out of the wall towards the robot."""

    x_m: float
    y_m: float
    normal_rad: float

    def right_of(self, other: WallPoint) -> float:
        """How far this point stands to the right of the other, as one looks at the wall (metres)."""
        dx, dy = self.x_m - other.x_m, self.y_m - other.y_m
        return -dx * sin(other.normal_rad) + dy * cos(other.normal_rad)

    def moved_right(self, by_m: float) -> WallPoint:
        """The point so much further right, as one looks at the wall."""
        return WallPoint(
            self.x_m - by_m * sin(self.normal_rad), self.y_m + by_m * cos(self.normal_rad), self.normal_rad
        )

    def off(self, other: WallPoint) -> float:
        """How far this point stands out of the other's wall (metres, unsigned)."""
        dx, dy = self.x_m - other.x_m, self.y_m - other.y_m
        return abs(dx * cos(other.normal_rad) + dy * sin(other.normal_rad))

    def distance_m(self, other: WallPoint) -> float:
        return hypot(self.x_m - other.x_m, self.y_m - other.y_m)


@dataclass(frozen=True, slots=True)
class WallLine:
    """The wall on the right in the robot's frame: perpendicular distance, and direction along it (about 0)."""

    distance_m: float
    along_rad: float
    measured: bool = True  # the direction; else it is taken for parallel to the robot

    def foot(self, pose: Pose2) -> WallPoint:
        """The point of the wall that is nearest to the pose."""
        at = self.point(pose, self.along_rad - pi / 2)
        assert at is not None
        return at

    def range_m(self, bearing_rad: float) -> float | None:
        """How far a ray goes until it meets the wall; None where it meets it at too flat an angle."""
        incidence_rad = wrap_angle(bearing_rad - (self.along_rad - pi / 2))
        if abs(incidence_rad) > INCIDENCE_MAX_RAD:
            return None
        return self.distance_m / cos(incidence_rad)

    def point(self, pose: Pose2, bearing_rad: float) -> WallPoint | None:
        """Where a ray from the pose meets the wall, in the map."""
        range_m = self.range_m(bearing_rad)
        if range_m is None:
            return None
        angle = pose.heading_rad + bearing_rad
        normal_rad = wrap_angle(pose.heading_rad + self.along_rad + pi / 2)
        return WallPoint(pose.x_m + range_m * cos(angle), pose.y_m + range_m * sin(angle), normal_rad)


class WallTracker:
    """The feet of the right sonar's echoes, newest last."""

    def __init__(self) -> None:
        self._feet: deque[tuple[float, float]] = deque(maxlen=FEET_KEPT)

    def add(self, pose: Pose2, right_m: float) -> None:
        """Takes an echo at `right_m` metres of a robot that drives straight or stands; NaN = no echo."""
        if isnan(right_m) or right_m > WALL_REACH_M:
            return
        angle = pose.heading_rad - pi / 2
        self._feet.append((pose.x_m + right_m * cos(angle), pose.y_m + right_m * sin(angle)))

    def wall(self, pose: Pose2) -> WallLine | None:
        """The wall beside a pose; None where there was no echo near it.

        Total least squares over the feet within ALONG_M of the one beside the robot, fitted again without those that
        lie off the line. A piece shorter than SPREAD_MIN_M counts as parallel to the robot.
        """
        feet = pose.inverse().transform(np.array(self._feet).reshape(-1, 2))
        beside = feet[(np.abs(feet[:, 0]) < ALONG_M) & (feet[:, 1] < 0.0)]
        if len(beside) < FEET_MIN:
            return None
        nearest = beside[np.argsort(np.abs(beside[:, 0]), kind="stable")[:FEET_MIN]]
        level_m = float(np.median(nearest[:, 1]))
        on_it = beside[np.abs(beside[:, 1] - level_m) < 2 * STEP_MAX_M]
        along_rad, level_m = _line(on_it)
        off_m = np.abs(on_it[:, 1] - level_m - np.tan(along_rad) * on_it[:, 0])
        plain = on_it[off_m < STEP_MAX_M]
        along_rad, level_m = _line(plain)
        rough_m = float(np.std(plain[:, 1] - np.tan(along_rad) * plain[:, 0])) if len(plain) else 0.0
        distance_m = -level_m * cos(along_rad)
        if abs(along_rad) > SKEW_MAX_RAD or rough_m > ROUGH_MAX_M or not 0.0 < distance_m < WALL_REACH_M:
            return None
        return WallLine(distance_m, along_rad, bool(np.ptp(plain[:, 0]) >= SPREAD_MIN_M))


def _line(feet: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> tuple[float, float]:
    """Direction of the line through points (N, 2), and its y at x = 0."""
    if not len(feet):
        return 0.0, 0.0
    centre = feet.mean(axis=0)
    spread_m = float(np.ptp(feet[:, 0]))
    if spread_m < SPREAD_MIN_M:
        return 0.0, float(centre[1])
    along_rad, _, _ = principal_axis(feet)
    return along_rad, float(centre[1] - np.tan(along_rad) * centre[0])
