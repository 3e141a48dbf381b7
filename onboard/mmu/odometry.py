"""Dead reckoning: an extended Kalman filter over wheel encoders and gyro.

Wheels give the distance, the gyro leads the heading; the wheels' own heading only bridges what the gyro cannot know.
State: x, y, heading, and how far the gyro's yaw has drifted from the heading. The frame is `odom`: continuous, never
corrected by the map.
"""

from __future__ import annotations

from math import cos, isfinite, pi, radians, sin

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from common.constants import TICK_M, WHEEL_TRACK_M
from common.geometry import FloatArray, Pose2, wrap_angle
from common.messages import Odometry

# Causes, as standard deviations
SLIP_SD_PER_SQRT_M = 0.01  # metres of slip per wheel after one metre
GYRO_DRIFT_SD_RAD_PER_SQRT_S = radians(0.05)  # between two standstills
GYRO_SD_RAD = radians(0.05)
MAX_STEP_M = 0.5  # more between two reports is no motion of this robot


class OdometryFilter:
    """Feeds on `Odometry` messages of one board session; `pose` and `covariance` (4, 4) are in `odom`."""

    def __init__(self, track_m: float = WHEEL_TRACK_M, tick_m: float = TICK_M) -> None:
        self._track_m, self._tick_m = track_m, tick_m
        self._filter = ExtendedKalmanFilter(dim_x=4, dim_z=1)
        self._filter.P = np.zeros((4, 4))
        self._last: Odometry | None = None
        self._yaw_unwrapped_rad = 0.0

    @property
    def pose(self) -> Pose2:
        return Pose2.from_array(self._filter.x.ravel())

    @property
    def covariance(self) -> FloatArray:
        covariance: FloatArray = self._filter.P
        return covariance

    def update(self, odometry: Odometry) -> bool:
        """Take one report in; False when it does not go on from the one before (the board restarted or jumped)."""
        if not all(map(isfinite, (odometry.t_s, odometry.yaw_rad))):
            return False
        last = self._last
        if last is not None and odometry.session == last.session and odometry.t_s <= last.t_s:
            return True
        self._last = odometry
        if last is None or odometry.session != last.session:
            # The board's yaw begins anew; the heading goes on
            self._yaw_unwrapped_rad = float(self._filter.x[2, 0] + self._filter.x[3, 0])
            return last is None
        left_m = (odometry.ticks_left - last.ticks_left) * self._tick_m
        right_m = (odometry.ticks_right - last.ticks_right) * self._tick_m
        dt_s = odometry.t_s - last.t_s
        if max(abs(left_m), abs(right_m)) > MAX_STEP_M:
            return False
        self._predict(left_m, right_m, dt_s, odometry.standing)
        turn_rad = wrap_angle(odometry.yaw_rad - last.yaw_rad)
        self._yaw_unwrapped_rad += turn_rad
        self._correct()
        return True

    def _predict(self, left_m: float, right_m: float, dt_s: float, standing: bool) -> None:
        x = self._filter.x.ravel()
        distance_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / self._track_m
        middle_rad = x[2] + turn_rad / 2
        c, s = cos(middle_rad), sin(middle_rad)
        self._filter.x = np.array([[x[0] + distance_m * c], [x[1] + distance_m * s], [x[2] + turn_rad], [x[3]]])
        jacobian = np.eye(4)
        jacobian[0, 2], jacobian[1, 2] = -distance_m * s, distance_m * c
        slip_variance = SLIP_SD_PER_SQRT_M**2 * (abs(left_m) + abs(right_m)) / 2
        along = np.array([c, s, 0.0, 0.0])
        process = np.outer(along, along) * slip_variance / 2
        process[2, 2] = 2 * slip_variance / self._track_m**2
        process[3, 3] = 0.0 if standing else GYRO_DRIFT_SD_RAD_PER_SQRT_S**2 * dt_s
        self._filter.P = jacobian @ self._filter.P @ jacobian.T + process

    def _correct(self) -> None:
        heading_rad, drift_rad = float(self._filter.x[2, 0]), float(self._filter.x[3, 0])
        expected = heading_rad + drift_rad
        z = expected + (self._yaw_unwrapped_rad - expected + pi) % (2 * pi) - pi
        row = np.array([[0.0, 0.0, 1.0, 1.0]])
        self._filter.update(
            np.array([[z]]),
            HJacobian=lambda _: row,
            Hx=lambda state: np.array([[state[2, 0] + state[3, 0]]]),
            R=np.array([[GYRO_SD_RAD**2]]),
        )
