"""Driving straight along a hall: walls, grid and distances in; the heading to steer and the openings passed out.

The leg takes the direction of the walls beside it, and so does every later leg: most buildings stand at right angles.
"""

from __future__ import annotations

from math import atan2, cos, radians, sin

import numpy as np

from common.geometry import FloatArray, Points, Pose2, RightAngles, wrap_angle
from onboard.planner.exploration.frontiers import Cells, Frontier, opening_on_the_right
from onboard.planner.exploration.right_hand_rule import shift_rad
from onboard.planner.grid.grid_map import GridMap

STEER_MAX_RAD = radians(10.0)
DIRECTIONS_MIN = 30  # of halls, before anything is inferred about the building
RIGHT_ANGLES_SHARE = 0.6
POINTS_MIN = 15  # on a wall
FOLLOW_SHARE = 0.15  # of the difference to the wall's direction, each time it is seen
OPENING_PATIENCE_M = 1.0  # of driving between two looks for an opening on the right


class HallFollowing:
    """The present leg (`start`, `heading_rad`), and what the halls so far show of the building's directions."""

    def __init__(self) -> None:
        self.start = Pose2(0.0, 0.0, 0.0)
        self.heading_rad = 0.0
        self._opening_seen = self.start
        self._right_angles = RightAngles()

    def begin(self, pose: Pose2, heading_rad: float) -> None:
        """A new leg from here."""
        self.start = self._opening_seen = pose
        self.heading_rad = heading_rad

    def see(self, points: Points, pose: Pose2) -> None:
        """Turn the leg towards the direction of the wall beside it; wall points (N, 2) in the map."""
        direction_rad = hall_direction_rad(points, pose, self.heading_rad)
        if direction_rad is not None:
            self._right_angles = self._right_angles.with_direction(direction_rad)
            self.heading_rad = wrap_angle(
                self.heading_rad + FOLLOW_SHARE * wrap_angle(direction_rad - self.heading_rad)
            )

    def along(self, heading_rad: float) -> float:
        """The building's own direction next to a heading, where it has right angles; else the same."""
        if self._right_angles.weight < DIRECTIONS_MIN or self._right_angles.share < RIGHT_ANGLES_SHARE:
            return heading_rad
        return wrap_angle(heading_rad - self._right_angles.offset_rad(heading_rad))

    def opening_passed(self, grid: GridMap, frontier: Frontier, pose: Pose2) -> Cells | None:
        """Frontier cells of an opening on the right; None where there is none, and for a while after each."""
        if self._opening_seen.distance_m(pose) <= OPENING_PATIENCE_M:
            return None
        opening = opening_on_the_right(grid, frontier, pose, self.heading_rad)
        if opening is not None:
            self._opening_seen = pose
        return opening

    def steered_rad(self, pose: Pose2, left_m: float, right_m: float) -> float:
        """Heading that keeps the leg and the distances to the walls (from the ring's centre, NaN = no echo).

        Never so far from the present one that the Carrier would stop to turn on the spot.
        """
        wanted_rad = self.heading_rad + shift_rad(left_m, right_m)
        change_rad = max(-STEER_MAX_RAD, min(STEER_MAX_RAD, wrap_angle(wanted_rad - pose.heading_rad)))
        return wrap_angle(pose.heading_rad + change_rad)


def hall_direction_rad(points: Points, pose: Pose2, heading_rad: float) -> float | None:
    """Direction of the wall on the right (else on the left) near the robot, within 20 degrees of `heading_rad`.

    Least squares over the wall points (N, 2), again without those that lie off; None where there is no plain wall.
    """
    c, s = cos(heading_rad), sin(heading_rad)
    x, y = points[:, 0] - pose.x_m, points[:, 1] - pose.y_m
    along, side = x * c + y * s, y * c - x * s
    near = (along > -3.0) & (along < 1.0)
    for sign in (-1.0, 1.0):
        off = side * sign
        mine = near & (off > 0.2) & (off < 3.5)
        slope = _wall_slope(along[mine], side[mine])
        if slope is not None and abs(slope) < 0.36:
            return wrap_angle(heading_rad + atan2(slope, 1.0))
    return None


def _wall_slope(x: FloatArray, y: FloatArray) -> float | None:
    """Of the straight wall that most of the points (N,) lie on; None where there is none."""
    if len(x) < POINTS_MIN:
        return None
    keep = np.abs(y - np.partition(y, len(y) // 2)[len(y) // 2]) < 0.3  # of the median
    slope = 0.0
    for _ in range(3):
        on_wall = x[keep]
        if len(on_wall) < POINTS_MIN or on_wall.max() - on_wall.min() < 1.2:
            return None
        slope, offset = _line_through(on_wall, y[keep])
        keep = np.abs(y - slope * x - offset) < 0.06
    return slope if np.count_nonzero(keep) > 0.6 * len(x) else None


def _line_through(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope and offset of the line through points (N,), by least squares."""
    x0, y0 = float(x.sum()) / len(x), float(y.sum()) / len(y)
    d = x - x0
    slope = float(d @ (y - y0)) / float(d @ d)
    return slope, y0 - slope * x0
