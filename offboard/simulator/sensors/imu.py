"""The simulated MPU-6050: true motion -> raw counts of accelerometer (+-2 g) and gyro (+-500 deg/s).

Error terms of the gyro as in the Allan deviation (IEEE Std 952): turn-on bias, random walk of the bias, scale, white
noise. The accelerometer is exact, since no module navigates by it.
"""

from __future__ import annotations

from math import degrees, sqrt
from random import Random

from offboard.simulator.error_profiles import RunErrors

GYRO_COUNTS_PER_DEG_S = 65.5
ACCEL_COUNTS_PER_M_S2 = 16384.0 / 9.80665

ImuCounts = tuple[int, int, int, int, int, int]  # ax, ay, az, gx, gy, gz


class Imu:
    """One sensor; the world calls `sample` once in each interval of `period_s`."""

    def __init__(self, errors: RunErrors, rng: Random, period_s: float) -> None:
        self._rng, self._white_rad_s = rng, errors.profile.gyro_white_rad_s
        self._scale = errors.gyro_scale_factor
        self._bias_rad_s = list(errors.gyro_bias_rad_s)
        self._walk_rad_s = errors.profile.gyro_walk_rad_s_sqrt_s * sqrt(period_s)

    def sample(self, yaw_rate_rad_s: float, forward_m_s2: float, left_m_s2: float) -> ImuCounts:
        """Counts for the means over the last interval: yaw rate in rad/s, accelerations in m/s^2."""
        ax, ay = _count(forward_m_s2 * ACCEL_COUNTS_PER_M_S2), _count(left_m_s2 * ACCEL_COUNTS_PER_M_S2)
        gx, gy, gz = (self._gyro_count(0, 0.0), self._gyro_count(1, 0.0), self._gyro_count(2, yaw_rate_rad_s))
        return ax, ay, 16384, gx, gy, gz

    def _gyro_count(self, axis: int, rate_rad_s: float) -> int:
        gauss, bias_rad_s = self._rng.gauss, self._bias_rad_s[axis]
        if self._walk_rad_s > 0.0:
            bias_rad_s += gauss(0.0, self._walk_rad_s)
            self._bias_rad_s[axis] = bias_rad_s
        measured_rad_s = rate_rad_s * self._scale + bias_rad_s
        if self._white_rad_s > 0.0:
            measured_rad_s += gauss(0.0, self._white_rad_s)
        return _count(degrees(measured_rad_s) * GYRO_COUNTS_PER_DEG_S)


def _count(value: float) -> int:
    count = round(value)
    return count if -32768 <= count <= 32767 else min(max(count, -32768), 32767)
