"""The simulated MPU-6050: true motion -> raw counts of accelerometer (+-2 g) and gyro (+-500 deg/s).

Error terms of the gyro as in the Allan deviation (IEEE Std 952): turn-on bias, random walk of the bias, scale, white
noise. The accelerometer is exact, since no module navigates by it. The arithmetic is in `native/body.cpp`.
"""

from __future__ import annotations

from math import sqrt
from random import Random

from offboard.simulator.error_profiles import RunErrors
from offboard.simulator.native.library import ImuState, NormalStream, library

GYRO_COUNTS_PER_DEG_S = 65.5
ACCEL_COUNTS_PER_M_S2 = 16384.0 / 9.80665

ImuCounts = tuple[int, int, int, int, int, int]  # ax, ay, az, gx, gy, gz


class Imu:
    """One sensor; it is sampled once in each interval of `period_s`."""

    def __init__(self, errors: RunErrors, rng: Random, period_s: float, heading_rad: float) -> None:
        """`heading_rad`: of the body, which stands."""
        self.state = ImuState(
            period_s=period_s,
            scale=errors.gyro_scale_factor,
            walk_rad_s=errors.profile.gyro_walk_rad_s_sqrt_s * sqrt(period_s),
            white_rad_s=errors.profile.gyro_white_rad_s,
            accel_counts=ACCEL_COUNTS_PER_M_S2,
            gyro_counts=GYRO_COUNTS_PER_DEG_S,
            bias_rad_s=errors.gyro_bias_rad_s,
            heading_rad=heading_rad,
        )
        self._normals = NormalStream(rng, self.state.normals)
        self._library = library()

    def sample(self, heading_rad: float, vx_m_s: float, vy_m_s: float) -> ImuCounts:
        """Counts for the means since the last sample; the body's heading and velocity are those of the floor."""
        self._library.imu_sample(self.state, heading_rad, vx_m_s, vy_m_s)
        return self.counts

    @property
    def counts(self) -> ImuCounts:
        """Of the last sample."""
        ax, ay, az, gx, gy, gz = self.state.counts
        return ax, ay, az, gx, gy, gz
