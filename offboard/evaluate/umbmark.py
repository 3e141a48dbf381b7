"""Wheel calibration by squares driven both ways: encoder counts, measured end points -> tick lengths, track. Pure.

After Borenstein & Feng, "Measurement and correction of systematic odometry errors in mobile robots" (UMBmark), IEEE
Trans. Robotics and Automation 12 (1996). Theirs is a closed form for a robot that steers by its encoders. This robot
steers by its gyro, so here the three parameters are fitted to the recorded counts instead:

1. Dead reckoning by encoders alone turns the counts of a run into the end point that they predict.
2. Gauss-Newton over both tick lengths and the track brings these to the end points that were measured.
Squares in both directions distinguish unequal wheels from a wrong track; a straight line gives the scale.
Assumption: what slips does so by chance, so that it averages out over the runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from common.constants import ENCODER_TICKS_PER_TURN, TICK_M, WHEEL_TRACK_M
from common.geometry import FloatArray

Counts = Sequence[tuple[int, int]]  # cumulative left and right ticks on the way
_ITERATIONS = 8
_NUDGE = 1e-5


@dataclass(frozen=True, slots=True)
class WheelFit:
    """What the runs show of the wheels."""

    left_diameter_m: float
    right_diameter_m: float
    track_m: float
    rms_m: float  # of the end points that remain unexplained, per coordinate

    @property
    def diameter_m(self) -> float:
        return (self.left_diameter_m + self.right_diameter_m) / 2.0

    @property
    def ratio(self) -> float:
        """Right over left."""
        return self.right_diameter_m / self.left_diameter_m


def end_point(counts: Counts, left_tick_m: float, right_tick_m: float, track_m: float) -> FloatArray:
    """(2,) where a robot ends that began at the origin along x, by its encoders alone."""
    ticks = np.asarray(counts, dtype=float)
    step = np.diff(ticks, axis=0) * (left_tick_m, right_tick_m)
    turn_rad = (step[:, 1] - step[:, 0]) / track_m
    heading_rad = np.concatenate([[0.0], np.cumsum(turn_rad)[:-1]]) + turn_rad / 2.0
    moved_m = step.mean(axis=1)
    return np.array([(moved_m * np.cos(heading_rad)).sum(), (moved_m * np.sin(heading_rad)).sum()])


def fit_wheels(runs: Sequence[tuple[Counts, tuple[float, float]]]) -> WheelFit:
    """`runs`: the counts of each run and where it really ended (x_m forward, y_m left of its start and first heading).

    Raises ValueError when there are fewer than three runs: a line, and a square each way.
    """
    if len(runs) < 3:
        raise ValueError("at least a straight line and a square in each direction are needed")
    nominal = np.array([TICK_M, TICK_M, WHEEL_TRACK_M])
    factors = np.ones(3)
    measured = np.concatenate([np.asarray(end_m, dtype=float) for _, end_m in runs])

    def predicted(scale: FloatArray) -> FloatArray:
        values: FloatArray = np.concatenate([end_point(counts, *(nominal * scale)) for counts, _ in runs])
        return values

    for _ in range(_ITERATIONS):
        now = predicted(factors)
        jacobian = np.stack([(predicted(factors + _NUDGE * unit) - now) / _NUDGE for unit in np.eye(3)], axis=1)
        factors = factors + np.linalg.lstsq(jacobian, measured - now, rcond=None)[0]
    rest = measured - predicted(factors)
    left_m, right_m, track_m = (float(value) for value in nominal * factors)
    per_turn = ENCODER_TICKS_PER_TURN / pi
    return WheelFit(left_m * per_turn, right_m * per_turn, track_m, float(np.sqrt(np.mean(rest**2))))
