"""A drive of any length round a made-up floor -> odometry and ranges, for measuring what the mapping unit costs.

Two islands in a hall of 2 m, 58 m by 20 m, with pilasters every few metres; always the same way round both. The sonars
measure the nearest foot of a wall within their beam, with noise and losses; the simulator would take an hour for a
kilometre.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, radians
from random import Random

import numpy as np

from common.constants import (
    SENSOR_RATE_HZ,
    SONAR_BEARINGS_RAD,
    SONAR_MAX_M,
    SONAR_STEP_M,
    SPEED_MEDIUM_M_S,
    TICK_M,
    WHEEL_TRACK_M,
)
from common.geometry import FloatArray, Pose2, wrap_angle, wrap_angles
from common.messages.motion import Odometry, Ranges

LENGTH_M, WIDTH_M, HALL_M, MIDDLE_M = 58.0, 20.0, 2.0, 29.0
PILASTER_M = (0.4, 0.15)  # along the wall and out of it
PILASTER_EVERY_M = 7.0
TURN_RAD_S = 0.8
BEAM_HALF_RAD = radians(32.0)
RANGE_SD_SHARE, LOST_SHARE = 0.01, 0.02
DRIFT_RAD_S = radians(0.01)
_PERIOD_S = 1.0 / SENSOR_RATE_HZ


def _box(x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> list[tuple[float, float, float, float]]:
    corners = [(x0_m, y0_m), (x1_m, y0_m), (x1_m, y1_m), (x0_m, y1_m)]
    return [(*a, *b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]


def _walls() -> FloatArray:
    """(N, 4)."""
    half = HALL_M / 2
    walls = _box(0.0, 0.0, LENGTH_M, WIDTH_M)
    walls += _box(HALL_M, HALL_M, MIDDLE_M - half, WIDTH_M - HALL_M)
    walls += _box(MIDDLE_M + half, HALL_M, LENGTH_M - HALL_M, WIDTH_M - HALL_M)
    along_m, out_m = PILASTER_M
    for x_m in np.arange(4.0, LENGTH_M - 4.0, PILASTER_EVERY_M).tolist():
        walls += _box(x_m, 0.0, x_m + along_m, out_m)
        walls += _box(x_m + 3.0, WIDTH_M - out_m, x_m + 3.0 + along_m, WIDTH_M)
    return np.array(walls)


class Course:
    """`messages` begins at the lower left corner of the floor; metres driven, odometry and ranges, ten a second."""

    def __init__(self, seed: int = 0) -> None:
        self._random = Random(seed)
        walls = _walls()
        self._from, self._along = walls[:, :2], walls[:, 2:] - walls[:, :2]
        self._length2 = (self._along**2).sum(axis=1)

    def messages(self, metres: float) -> Iterator[tuple[float, Odometry, Ranges]]:
        driven_m = turned_rad = 0.0
        left_m = right_m = 0.0
        last: Pose2 | None = None
        for tick, pose in enumerate(self._path()):
            step_m = 0.0 if last is None else last.distance_m(pose)
            step_rad = 0.0 if last is None else wrap_angle(pose.heading_rad - last.heading_rad)
            driven_m, turned_rad, last = driven_m + step_m, turned_rad + step_rad, pose
            left_m += step_m - step_rad * WHEEL_TRACK_M / 2
            right_m += step_m + step_rad * WHEEL_TRACK_M / 2
            t_s = tick * _PERIOD_S
            ticks = round(left_m / TICK_M), round(right_m / TICK_M)
            yaw_rad = wrap_angle(turned_rad + DRIFT_RAD_S * t_s)
            odometry = Odometry(t_s, *ticks, yaw_rad, 0.0, 0.0, 0.0, step_m / _PERIOD_S, False, False, False, session=1)
            yield driven_m, odometry, Ranges(t_s, self._ranges(pose), (0.0,) * len(SONAR_BEARINGS_RAD))
            if driven_m >= metres:
                return

    def _path(self) -> Iterator[Pose2]:
        """True poses: round the left island, then round the right one, again and again."""
        low, high = HALL_M / 2, WIDTH_M - HALL_M / 2
        left, right = HALL_M / 2, LENGTH_M - HALL_M / 2
        lap = [(MIDDLE_M, low), (MIDDLE_M, high), (left, high), (left, low)]
        lap += [(MIDDLE_M, low), (right, low), (right, high), (MIDDLE_M, high), (MIDDLE_M, low), (left, low)]
        pose = Pose2(left, low, 0.0)
        while True:
            for x_m, y_m in lap:
                while abs(off_rad := pose.bearing_rad(x_m, y_m)) > 0.01 and hypot(x_m - pose.x_m, y_m - pose.y_m) > 0.1:
                    reach_rad = TURN_RAD_S * _PERIOD_S
                    pose = pose.compose(Pose2(0.0, 0.0, max(-reach_rad, min(reach_rad, off_rad))))
                    yield pose
                while (to_go_m := hypot(x_m - pose.x_m, y_m - pose.y_m)) > 1e-6:
                    pose = pose.compose(Pose2(min(SPEED_MEDIUM_M_S * _PERIOD_S, to_go_m), 0.0, 0.0))
                    yield pose

    def _ranges(self, pose: Pose2) -> tuple[float, ...]:
        offset = np.array([pose.x_m, pose.y_m]) - self._from
        share = (offset * self._along).sum(axis=1) / self._length2
        on_wall = (share >= 0.0) & (share <= 1.0)
        feet = (share[:, None] * self._along - offset)[on_wall]
        distance = np.hypot(feet[:, 0], feet[:, 1])
        near = distance < SONAR_MAX_M
        bearing = np.arctan2(feet[near, 1], feet[near, 0]) - pose.heading_rad
        return tuple(self._echoes(b, bearing, distance[near]) for b in SONAR_BEARINGS_RAD)

    def _echoes(self, bearing_rad: float, bearings: FloatArray, distances: FloatArray) -> float:
        off = wrap_angles(bearings - bearing_rad)
        in_beam = distances[np.abs(off) < BEAM_HALF_RAD]
        if not len(in_beam) or self._random.random() < LOST_SHARE:
            return float("nan")
        range_m = float(in_beam.min()) * self._random.gauss(1.0, RANGE_SD_SHARE)
        return range_m // SONAR_STEP_M * SONAR_STEP_M
