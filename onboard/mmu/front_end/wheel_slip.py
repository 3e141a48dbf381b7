"""How much the wheels slip, measured by how much they disagree with the gyro about the turns.

Each wheel slips on its own: what turns the robot a little also drives it a little too far or too short. Wheels of
unlike size disagree with the gyro alike on every piece of path, slip does not: what counts is how much neighbouring
pieces differ, and their median, because a sill is no slip.
"""

from __future__ import annotations

from collections import deque
from math import radians, sqrt
from statistics import median

# The sensitivity to these was not measured
PIECE_M = 1.0
PIECES_MIN = 8
PIECES_MAX = 40
TURN_MAX_RAD = radians(10.0)  # a turn shows how far the wheels are apart, too
SLIP_MIN_M_PER_SQRT_M = 0.003  # of both wheels alike, which nothing here would show
MEDIAN_OF_NORMAL = 0.6745  # of the absolute value, in standard deviations


class WheelSlip:
    def __init__(self, track_m: float) -> None:
        self._track_m = track_m
        self._apart_rad: deque[float] = deque(maxlen=PIECES_MAX)  # neighbouring pieces
        self._before_rad: float | None = None
        self._path_m = self._turned_rad = self._disagreement_rad = 0.0

    def drive(self, left_m: float, right_m: float, turned_rad: float) -> None:
        """Wheels and gyro (radians, left positive) since the last call."""
        self._path_m += abs(left_m + right_m) / 2
        self._turned_rad += abs(turned_rad)
        self._disagreement_rad += (right_m - left_m) / self._track_m - turned_rad
        if self._path_m < PIECE_M and self._turned_rad < TURN_MAX_RAD:
            return
        straight = self._turned_rad < TURN_MAX_RAD
        if straight and self._before_rad is not None:
            self._apart_rad.append(abs(self._disagreement_rad - self._before_rad))
        self._before_rad = self._disagreement_rad if straight else None
        self._path_m = self._turned_rad = self._disagreement_rad = 0.0

    @property
    def along_m_per_sqrt_m(self) -> float | None:
        """Standard deviation of the path after one metre; None while it is not known yet."""
        if len(self._apart_rad) < PIECES_MIN:
            return None
        of_piece_rad = median(self._apart_rad) / MEDIAN_OF_NORMAL / sqrt(2.0)
        return max(SLIP_MIN_M_PER_SQRT_M, self._track_m / 2 * of_piece_rad / sqrt(PIECE_M))
