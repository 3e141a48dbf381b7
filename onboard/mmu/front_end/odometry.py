"""Dead reckoning: an extended Kalman filter over wheel encoders and gyro.

Wheels give the distance, the gyro leads the heading; the wheels' own heading only bridges what the gyro cannot measure.
State: x, y, heading, and how far the gyro's yaw has drifted from the heading. The frame is `odom`: continuous, never
corrected by the map.
"""

from __future__ import annotations

from math import cos, hypot, isfinite, radians, sin

import numpy as np

from common.constants import TICK_M, WHEEL_TRACK_M
from common.geometry import FloatArray, Pose2, wrap_angle
from common.messages.motion import Odometry
from onboard.mmu.front_end.kalman import ExtendedKalmanFilter
from onboard.mmu.front_end.wheel_slip import WheelSlip

# Causes of errors, as standard deviations. The sensitivity was not measured
SLIP_SD_PER_SQRT_M = 0.01  # metres of slip per wheel after one metre
GYRO_DRIFT_SD_RAD_PER_SQRT_S = radians(0.05)  # between two standstills
GYRO_SD_RAD = radians(0.05)
HAND_TURN_RAD_S = radians(1.0)  # faster than a gyro at rest drifts: whoever turns so while the wheels stand is turned
MAX_SPEED_M_S = 1.0  # of a wheel: what goes further between two reports is no motion of this robot
MAX_STEP_M = 0.1  # on top of that
MAX_GAP_S = 5.0  # a board that receives no heartbeat stands: it drives no further than it can in so long
MAX_SILENCE_S = 600.0  # what comes from later than that is from another time, as is what lies MAX_GAP_S back
GAP_S = 0.25  # over a longer gap the board's own dead reckoning knows the path better than one arc does
JUMP_REPORTS = 5  # reports that agree with each other and not with what came before: the ticks did jump


class OdometryFilter:
    """Feeds on `Odometry` messages of one board session; `pose` and `covariance` (4, 4) are in `odom`."""

    def __init__(self, track_m: float = WHEEL_TRACK_M, tick_m: float = TICK_M) -> None:
        self._track_m, self._tick_m = track_m, tick_m
        self._filter = ExtendedKalmanFilter(dim_x=4, dim_z=1)
        self._filter.P = np.zeros((4, 4))
        self._last: Odometry | None = None
        self._pose = Pose2(0.0, 0.0, 0.0)
        self._calibration = (0.0, 0.0)  # rad per metre, rad per radian
        self.slip = WheelSlip(track_m)
        self.turned_rad = 0.0  # all turns so far, as measured
        self.calibrated_rad = 0.0  # all that the calibration added to them
        self._yaw_unwrapped_rad = 0.0
        self._jumped: tuple[Odometry, int] | None = None
        self.kidnapped = False  # the path since the last report is not known; who acts on it clears it

    @property
    def pose(self) -> Pose2:
        return self._pose

    @property
    def covariance(self) -> FloatArray:
        covariance: FloatArray = self._filter.P
        return covariance

    def update(self, odometry: Odometry) -> bool:
        """Take one report in; False when it does not continue the one before (the board restarted or jumped)."""
        if not all(map(isfinite, (odometry.t_s, gyro_yaw_rad(odometry)))):
            return False
        last = self._last
        if last is None or odometry.session != last.session:
            # The board's yaw begins at zero again; the heading continues
            self._last, self._jumped = odometry, None
            self._yaw_unwrapped_rad = float(self._filter.x[2, 0] + self._filter.x[3, 0])
            return last is None
        if -MAX_GAP_S < odometry.t_s - last.t_s <= 0.0:
            return True
        if not _reachable(last, odometry, self._tick_m):
            self._jump(odometry)
            return False
        self._last, self._jumped = odometry, None
        before = Pose2.from_array(self._filter.x.ravel().tolist())
        dt_s = odometry.t_s - last.t_s
        left_m = (odometry.ticks_left - last.ticks_left) * self._tick_m
        right_m = (odometry.ticks_right - last.ticks_right) * self._tick_m
        turned_rad = wrap_angle(gyro_yaw_rad(odometry) - gyro_yaw_rad(last))
        by_hand = left_m == right_m == 0.0 and abs(turned_rad) > HAND_TURN_RAD_S * dt_s
        self._predict(left_m, right_m, dt_s, odometry.standing, turned_rad if by_hand else 0.0)
        self._yaw_unwrapped_rad += turned_rad
        self.slip.drive(left_m, right_m, turned_rad)
        self._correct()
        moved = before.between(Pose2.from_array(self._filter.x.ravel().tolist()))
        if dt_s > GAP_S:
            board = board_pose(last).between(board_pose(odometry))
            moved = Pose2(board.x_m, board.y_m, moved.heading_rad)
        self._move(moved)
        return True

    def _jump(self, odometry: Odometry) -> None:
        """A broken report, or the first after a jump: those that follow show which."""
        after = self._jumped
        continues = after is not None and after[0].t_s < odometry.t_s and _reachable(after[0], odometry, self._tick_m)
        count = after[1] + 1 if after is not None and continues else 1
        self._jumped = (odometry, count)
        if count >= JUMP_REPORTS:
            self._last, self._jumped = odometry, None
            self._yaw_unwrapped_rad = float(self._filter.x[2, 0] + self._filter.x[3, 0])
            self.kidnapped = True

    def begin_at(self, pose: Pose2) -> None:
        """`odom` continues from this pose."""
        self._pose = pose

    def move(self, measured: Pose2) -> None:
        """A carrier without ticks: where it is now, as seen from where it was."""
        self._move(measured)

    def calibrate(self, rad_per_m: float, rad_per_rad: float) -> None:
        """From now on every path turns by so much more than measured: the calibration that the back end estimated."""
        self._calibration = rad_per_m, rad_per_rad

    def _move(self, measured: Pose2) -> None:
        distance_m = hypot(measured.x_m, measured.y_m)
        added_rad = self._calibration[0] * distance_m + self._calibration[1] * measured.heading_rad
        self.turned_rad += measured.heading_rad
        self.calibrated_rad += added_rad
        c, s = cos(added_rad / 2), sin(added_rad / 2)
        x_m, y_m = c * measured.x_m - s * measured.y_m, s * measured.x_m + c * measured.y_m
        self._pose = self._pose.compose(Pose2(x_m, y_m, wrap_angle(measured.heading_rad + added_rad)))

    def _predict(self, left_m: float, right_m: float, dt_s: float, standing: bool, by_hand_rad: float) -> None:
        """`by_hand_rad`: so far it was turned by hand, of which the wheels know nothing."""
        x_m, y_m, heading_rad, drift_rad = self._filter.x.ravel().tolist()
        distance_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / self._track_m
        middle_rad = heading_rad + turn_rad / 2
        c, s = cos(middle_rad), sin(middle_rad)
        self._filter.x = np.array(
            [[x_m + distance_m * c], [y_m + distance_m * s], [heading_rad + turn_rad], [drift_rad]]
        )
        jacobian = np.eye(4)
        jacobian[0, 2], jacobian[1, 2] = -distance_m * s, distance_m * c
        slip_variance = SLIP_SD_PER_SQRT_M**2 * (abs(left_m) + abs(right_m)) / 2
        process = np.zeros((4, 4))
        process[0, 0], process[1, 1] = c * c * slip_variance / 2, s * s * slip_variance / 2
        process[0, 1] = process[1, 0] = c * s * slip_variance / 2
        process[2, 2] = 2 * slip_variance / self._track_m**2 + by_hand_rad**2
        process[3, 3] = 0.0 if standing else GYRO_DRIFT_SD_RAD_PER_SQRT_S**2 * dt_s
        self._filter.P = jacobian @ self._filter.P @ jacobian.T + process

    def _correct(self) -> None:
        heading_rad, drift_rad = float(self._filter.x[2, 0]), float(self._filter.x[3, 0])
        expected = heading_rad + drift_rad
        z = expected + wrap_angle(self._yaw_unwrapped_rad - expected)
        row = np.array([[0.0, 0.0, 1.0, 1.0]])
        self._filter.update(
            np.array([[z]]),
            HJacobian=lambda _: row,
            Hx=lambda state: np.array([[state[2, 0] + state[3, 0]]]),
            R=np.array([[GYRO_SD_RAD**2]]),
        )


def gyro_yaw_rad(odometry: Odometry) -> float:
    """Without what the board took from walls: the back end uses them too, and they must not count twice."""
    return odometry.yaw_rad - odometry.yaw_by_walls_rad


def board_pose(odometry: Odometry) -> Pose2:
    """The board's own dead reckoning since it was switched on."""
    return Pose2(odometry.x_m, odometry.y_m, odometry.yaw_rad)


def _reachable(last: Odometry, odometry: Odometry, tick_m: float) -> bool:
    ticks = max(
        abs(odometry.ticks_left - last.ticks_left),
        abs(odometry.ticks_right - last.ticks_right),
    )
    dt_s = odometry.t_s - last.t_s
    path_m = max(ticks * tick_m, board_pose(last).distance_m(board_pose(odometry)))
    return 0.0 < dt_s < MAX_SILENCE_S and path_m <= MAX_STEP_M + MAX_SPEED_M_S * min(dt_s, MAX_GAP_S)
