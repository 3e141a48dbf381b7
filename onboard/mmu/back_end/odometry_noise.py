"""How far odometry may be wrong: led by a gyro, by wheels alone, or not known which."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.back_end.pose_graph import DriftPrior

SEARCH_M = 0.8
SEARCH_MAX_M = 4.0
SEARCH_RAD = 0.06
SEARCH_MAX_RAD = 0.4
LENGTH_SD = 0.007  # share of the way: what calibrated wheels get wrong


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Of a way between key frames, as standard deviations; what the graph's two slow errors do not explain."""

    heading_rad_per_sqrt_m: float
    heading_share: float  # of the turn
    drift: DriftPrior
    lost_m_per_m: float = 0.02  # three standard deviations of the place, by the way since the last closure
    lost_rad_per_m: float = 0.002
    along_m: float = 0.003
    slip_m_per_sqrt_m: float = 0.015  # of the way, where nothing tells
    across_share: float = 0.005
    heading_rad: float = radians(0.05)
    same_rad: float = radians(2.5)  # by how much walls seem to differ at most that are one, or at right angles

    def information(self, way_m: float, turn_rad: float, slip_m_per_sqrt_m: float | None = None) -> FloatArray:
        """(3, 3) of the relative pose at the end of such a way; `slip_m_per_sqrt_m`: where it is known."""
        along_sd = self.along_m + self.slip(slip_m_per_sqrt_m) * way_m**0.5
        across_sd = 0.003 + self.across_share * way_m
        heading_sd = self.heading_rad + self.heading_rad_per_sqrt_m * way_m**0.5 + self.heading_share * abs(turn_rad)
        return np.diag([along_sd**-2, across_sd**-2, heading_sd**-2])

    def slip(self, known_m_per_sqrt_m: float | None) -> float:
        """Of the way after one metre, as a standard deviation: the known one, or what is to be expected."""
        return self.slip_m_per_sqrt_m if known_m_per_sqrt_m is None else known_m_per_sqrt_m

    def search_window(self, since_m: float) -> tuple[float, float]:
        """How far off (metres, radians) the robot may be after so much way without a closure."""
        return (
            min(SEARCH_M + self.lost_m_per_m * since_m, SEARCH_MAX_M),
            min(SEARCH_RAD + self.lost_rad_per_m * since_m, SEARCH_MAX_RAD),
        )


# A cheap gyro's bias wanders, and is measured anew whenever the robot stands still, which it sees to. What the yaw lost
# until then is known by half: 0.04 deg are left after 12 s, which are 2 m, hence 0.09 deg after a stretch of 10 m.
GYRO_LED = OdometryErrors(
    radians(0.03),
    0.001,
    DriftPrior(radians(0.009), None, 0.004, LENGTH_SD),
    along_m=0.002,
    heading_rad=radians(0.01),
    same_rad=radians(1.2),
)
UNKNOWN = OdometryErrors(radians(0.05), 0.003, DriftPrior(radians(0.1), radians(0.01), 0.01, LENGTH_SD))
WHEELS_ALONE = OdometryErrors(radians(1.5), 0.03, DriftPrior(radians(2.0), radians(0.1), 0.03, LENGTH_SD), 0.05, 0.006)
