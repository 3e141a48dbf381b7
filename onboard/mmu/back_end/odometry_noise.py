"""How far odometry may be wrong: with a gyro that leads its heading, with wheels alone, or where that is not known."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray
from onboard.mmu.back_end.calibration_priors import CalibrationPrior

# How widely a scan match searches: it grows with the path through the graph. The sensitivity was not measured
SEARCH_M = 0.8
SEARCH_MAX_M = 4.0
SEARCH_RAD = 0.06
SEARCH_MAX_RAD = 0.4
WHEEL_SCALE_SD = 0.007  # m/m: what calibrated wheels get wrong


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Of a path between keyframes, as standard deviations: what the calibration states do not explain."""

    heading_rad_per_sqrt_m: float
    heading_share: float  # of the turn
    calibration: CalibrationPrior
    lost_m_per_m: float = 0.02  # three standard deviations of the place, by the path through the graph
    lost_rad_per_m: float = 0.002
    lost_max_m: float = SEARCH_MAX_M  # however long that path is, the place is searched for no further off
    lost_max_rad: float = SEARCH_MAX_RAD
    along_m: float = 0.003
    slip_m_per_sqrt_m: float = 0.015  # of the path, where nothing shows it
    across_share: float = 0.005
    heading_rad: float = radians(0.05)
    same_rad: float = radians(2.5)  # how much the directions of one wall, or of right angles, may seem to differ

    def information(self, path_m: float, turn_rad: float, slip_m_per_sqrt_m: float | None = None) -> FloatArray:
        """(3, 3) of the relative pose at the end of such a path; `slip_m_per_sqrt_m`: where it is known."""
        along_sd = self.along_m + self.slip(slip_m_per_sqrt_m) * path_m**0.5
        across_sd = 0.003 + self.across_share * path_m
        heading_sd = self.heading_rad + self.heading_rad_per_sqrt_m * path_m**0.5 + self.heading_share * abs(turn_rad)
        return np.diag([along_sd**-2, across_sd**-2, heading_sd**-2])

    def slip(self, known_m_per_sqrt_m: float | None) -> float:
        """Of the path after one metre, as a standard deviation: the known one, or what is to be expected."""
        return self.slip_m_per_sqrt_m if known_m_per_sqrt_m is None else known_m_per_sqrt_m

    def lost_m(self, graph_path_m: npt.ArrayLike) -> FloatArray:
        """How far off (metres) the robot may be after such paths through the graph (any shape)."""
        lost_m: FloatArray = SEARCH_M + self.lost_m_per_m * np.asarray(graph_path_m, dtype=np.float64)
        return np.minimum(lost_m, self.lost_max_m)

    def search_window(self, graph_path_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Of one search (metres, radians), after such paths through the graph (any shape)."""
        graph_paths_m = np.asarray(graph_path_m, dtype=np.float64)
        return (
            np.minimum(self.lost_m(graph_paths_m), SEARCH_MAX_M),
            np.minimum(SEARCH_RAD + self.lost_rad_per_m * graph_paths_m, self.lost_max_rad),
        )


# A cheap gyro's bias wanders, and a zero-velocity update measures it anew whenever the robot stands still, as it does
# every few seconds. The yaw lost until then is corrected by half: 0.04 deg are left after 12 s, which are 2 m, hence
# 0.09 deg after a stretch of 10 m.
GYRO_LED = OdometryNoise(
    radians(0.03),
    0.001,
    CalibrationPrior(radians(0.009), None, 0.004, WHEEL_SCALE_SD),
    along_m=0.002,
    heading_rad=radians(0.01),
    same_rad=radians(1.2),
)
# Of five logs of wheels with a gyro: less a constant drift, the heading errs by 0.3 to 0.5 degrees over a metre,
# 1.0 to 1.5 over 10 m, 1.6 to 2.5 over 30 m. So it is noise that grows with the root of the path, while the drift
# stays. Taken for a drift that wanders, it turns the whole run by what one short loop measured.
UNKNOWN = OdometryNoise(radians(0.3), 0.003, CalibrationPrior(radians(0.05), radians(0.002), 0.01, WHEEL_SCALE_SD))
# Of two logs of wheels alone, from 10 to 80 m: it errs by 1.4 to 2.6 degrees per root of a metre on hard floor (less a
# constant drift), by 3.2 to 4.4 on carpet.
WHEELS_ALONE = OdometryNoise(
    radians(2.5),
    0.03,
    CalibrationPrior(radians(2.0), radians(0.1), 0.03, WHEEL_SCALE_SD),
    lost_m_per_m=0.05,
    lost_rad_per_m=0.012,
    lost_max_m=10.0,
    lost_max_rad=0.7,
)
