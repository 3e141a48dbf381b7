"""Extended Kalman filter over a robot's pose and the drift of its gyro's yaw, by wheels and gyro.

Written out in plain numbers: for four states a matrix library takes ten times as long.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

from common.geometry import Pose2, wrap_angle


@dataclass(slots=True)
class YawDriftFilter:
    """State: x and y (m), heading h and drift d (rad); `p..` is its covariance, symmetric, zero at first."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    drift_rad: float = 0.0  # how far the gyro's yaw is ahead of the heading
    pxx: float = 0.0
    pxy: float = 0.0
    pxh: float = 0.0
    pxd: float = 0.0
    pyy: float = 0.0
    pyh: float = 0.0
    pyd: float = 0.0
    phh: float = 0.0
    phd: float = 0.0
    pdd: float = 0.0

    @property
    def pose(self) -> Pose2:
        return Pose2(self.x_m, self.y_m, wrap_angle(self.heading_rad))

    @property
    def yaw_rad(self) -> float:
        """What the gyro should show."""
        return self.heading_rad + self.drift_rad

    def predict(
        self,
        distance_m: float,
        turn_rad: float,
        distance_variance: float,
        turn_variance: float,
        drift_variance: float,
    ) -> None:
        """An arc that the wheels drove, and how uncertain that and the drift meanwhile are."""
        middle_rad = self.heading_rad + turn_rad / 2
        c, s = cos(middle_rad), sin(middle_rad)
        # Derivatives of x and y by the heading
        a, b = -distance_m * s, distance_m * c
        self.x_m += distance_m * c
        self.y_m += distance_m * s
        self.heading_rad += turn_rad
        self.pxx += a * (2 * self.pxh + a * self.phh) + c * c * distance_variance
        self.pxy += a * self.pyh + b * self.pxh + a * b * self.phh + c * s * distance_variance
        self.pyy += b * (2 * self.pyh + b * self.phh) + s * s * distance_variance
        self.pxh += a * self.phh
        self.pxd += a * self.phd
        self.pyh += b * self.phh
        self.pyd += b * self.phd
        self.phh += turn_variance
        self.pdd += drift_variance

    def correct(self, yaw_rad: float, variance: float) -> None:
        """The yaw of the gyro, up to whole turns: heading plus drift."""
        x, y, h, d = self.pxh + self.pxd, self.pyh + self.pyd, self.phh + self.phd, self.phd + self.pdd
        total = h + d + variance
        gain = wrap_angle(yaw_rad - self.yaw_rad) / total
        self.x_m += x * gain
        self.y_m += y * gain
        self.heading_rad += h * gain
        self.drift_rad += d * gain
        self.pxx -= x * x / total
        self.pxy -= x * y / total
        self.pxh -= x * h / total
        self.pxd -= x * d / total
        self.pyy -= y * y / total
        self.pyh -= y * h / total
        self.pyd -= y * d / total
        self.phh -= h * h / total
        self.phd -= h * d / total
        self.pdd -= d * d / total
