"""Planar poses and angles: the one place where an angle is wrapped and a frame is changed.

Radians counter-clockwise, x forward, y left. `map_from_robot` is the robot's pose in the map: it carries points of the
robot's frame into the map's.
"""

from __future__ import annotations

from cmath import phase, rect
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Points = npt.NDArray[np.float64]  # (N, 2), metres


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = (angle_rad + pi) % (2 * pi) - pi
    return pi if wrapped == -pi else wrapped


def wrap_angles(angles_rad: npt.ArrayLike) -> FloatArray:
    """Like `wrap_angle`, for arrays of any shape (-pi stays -pi)."""
    return (np.asarray(angles_rad, dtype=np.float64) + pi) % (2 * pi) - pi


@dataclass(frozen=True, slots=True)
class Pose2:
    """A position (metres) and a heading (radians) in the plane; also the transform from its own frame to its parent."""

    x_m: float
    y_m: float
    heading_rad: float

    def compose(self, other: Pose2) -> Pose2:
        """self * other: `map_from_a.compose(a_from_b)` is `map_from_b`."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return Pose2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_angle(self.heading_rad + other.heading_rad),
        )

    def inverse(self) -> Pose2:
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return Pose2(-c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, wrap_angle(-self.heading_rad))

    def between(self, other: Pose2) -> Pose2:
        """`other` as seen from `self`."""
        return self.inverse().compose(other)

    def transform(self, points: npt.ArrayLike) -> Points:
        """Points (..., 2) of this pose's own frame, in its parent's frame."""
        p = np.asarray(points, dtype=np.float64)
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return np.stack([self.x_m + c * p[..., 0] - s * p[..., 1], self.y_m + s * p[..., 0] + c * p[..., 1]], axis=-1)

    def distance_m(self, other: Pose2) -> float:
        return hypot(other.x_m - self.x_m, other.y_m - self.y_m)

    def bearing_rad(self, x_m: float, y_m: float) -> float:
        """Direction of a point relative to this heading, left positive."""
        return wrap_angle(atan2(y_m - self.y_m, x_m - self.x_m) - self.heading_rad)

    def as_array(self) -> FloatArray:
        return np.array([self.x_m, self.y_m, self.heading_rad])

    @classmethod
    def from_array(cls, a: Any) -> Pose2:
        return cls(float(a[0]), float(a[1]), wrap_angle(float(a[2])))


@dataclass(frozen=True, slots=True)
class RightAngles:
    """Directions of walls or halls, summed up: do they stand at right angles, and which way?

    Each is a unit vector at four times its direction, where all that stands at right angles points the same way (Mardia
    and Jupp 2000, directional statistics).
    """

    weight: float = 0.0
    resultant: complex = 0j

    def with_direction(self, direction_rad: float, weight: float = 1.0) -> RightAngles:
        """These and one direction more; `weight` in any unit, the same for all."""
        return RightAngles(self.weight + weight, self.resultant + weight * rect(1.0, 4 * direction_rad))

    @property
    def share(self) -> float:
        """Mean resultant length. 0: all directions alike, 1: all at right angles."""
        return abs(self.resultant) / self.weight if self.weight else 0.0

    @property
    def direction_rad(self) -> float:
        """That of the four directions at right angles which lies in (-pi/4, pi/4]."""
        return phase(self.resultant) / 4

    def offset_rad(self, direction_rad: float) -> float:
        """How far a direction is turned from the nearest right angle, in (-pi/4, pi/4], left positive."""
        return wrap_angle(4 * (direction_rad - self.direction_rad)) / 4


def principal_axis(points: Points) -> tuple[float, float, float]:
    """The line that points (N, 2), N > 1, spread along: its direction in (-pi/2, pi/2], variances across and along it.

    Total least squares: the axes of the covariance's ellipse.
    """
    (a, b), (_, d) = np.cov((points - points.mean(axis=0)).T)
    across, along = np.linalg.eigvalsh([[a, b], [b, d]]).tolist()
    return 0.5 * atan2(2 * b, a - d), across, along


def principal_axes(xx: float, xy: float, yy: float) -> tuple[float, float, float]:
    """Of a covariance in the plane: its largest and smallest variance, and the direction of the largest (rad)."""
    middle, apart = (xx + yy) / 2, hypot((xx - yy) / 2, xy)
    return middle + apart, middle - apart, atan2(2 * xy, xx - yy) / 2


def rigid_fit(source: Points, target: Points) -> Pose2:
    """The rigid motion that brings `source` (N, 2) onto `target` (N, 2) with the least squared distance.

    Closed form of the planar Procrustes problem (Arun et al. 1987).
    """
    centre_s, centre_t = source.mean(axis=0), target.mean(axis=0)
    h = (source - centre_s).T @ (target - centre_t)
    angle = atan2(h[0, 1] - h[1, 0], h[0, 0] + h[1, 1])
    rotated = Pose2(0.0, 0.0, angle).transform(centre_s)
    return Pose2(float(centre_t[0] - rotated[0]), float(centre_t[1] - rotated[1]), angle)
