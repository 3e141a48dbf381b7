"""Priors on the calibration states: how large odometry's systematic errors may be before anything was measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.back_end.factors import FactorGroup
from onboard.mmu.back_end.robust_loss import CAUCHY, QUADRATIC, Loss
from onboard.mmu.back_end.states import Columns, Layout, States

UNKNOWN_SD_RAD = 100.0  # of a direction about which nothing is known beforehand


@dataclass(frozen=True, slots=True)
class CalibrationPrior:
    """Standard deviations of odometry's systematic errors."""

    drift_rad_per_m: float
    # Of the drift's change from one stretch to the next. None: every stretch begins at zero, as after a zero-velocity
    # update of the gyro's bias
    drift_step_rad_per_m: float | None
    turn_scale_error: float  # rad/rad
    wheel_scale_error: float  # m/m

    def groups(self, layout: Layout) -> tuple[FactorGroup, ...]:
        """The factors that it stands for."""
        scales = ScalePriors(self, layout)
        if self.drift_step_rad_per_m is None:
            return scales, ZeroVelocityDriftPriors(layout.stretches, self.drift_rad_per_m)
        return scales, DriftRandomWalk(layout.stretches, self.drift_rad_per_m, self.drift_step_rad_per_m)


class _DirectPriors(FactorGroup):
    """Each of some states is zero, with its standard deviation."""

    def __init__(self, sd: FloatArray) -> None:
        self._sd = sd

    def jacobian(self, states: States) -> FloatArray:
        return np.ones((len(self._sd), 1, 1))

    @property
    def information(self) -> FloatArray:
        information: FloatArray = (self._sd**-2)[:, None, None]
        return information


class ScalePriors(_DirectPriors):
    """Scales of wheels and turns are right; of the directions of walls nothing is known."""

    loss: ClassVar[Loss] = QUADRATIC

    def __init__(self, prior: CalibrationPrior, layout: Layout) -> None:
        known = [prior.wheel_scale_error, prior.turn_scale_error]
        super().__init__(np.array([*known, *[UNKNOWN_SD_RAD] * (1 + layout.walls)]))

    def error(self, states: States) -> FloatArray:
        scalars = [states.wheel_scale_error, states.turn_scale_error, states.right_angles_rad]
        return np.concatenate([scalars, states.wall_normals_rad])[:, None]

    def columns(self, layout: Layout) -> Columns:
        walls = np.arange(layout.wall_normals, layout.size)
        scalars = [layout.wheel_scale_error, layout.turn_scale_error, layout.right_angles]
        return np.concatenate([scalars, walls], dtype=np.int32)[:, None]


class ZeroVelocityDriftPriors(_DirectPriors):
    """After a zero-velocity update a gyro drifts little; now and then one is far worse than its kind."""

    loss: ClassVar[Loss] = CAUCHY

    def __init__(self, stretches: int, sd_rad_per_m: float) -> None:
        super().__init__(np.full(stretches, sd_rad_per_m))

    def error(self, states: States) -> FloatArray:
        return states.drift_rad_per_m[:, None]

    def columns(self, layout: Layout) -> Columns:
        return np.arange(layout.drift, layout.wall_normals, dtype=np.int32)[:, None]


class DriftRandomWalk(FactorGroup):
    """The drift of a stretch is that of the one before, but for a small step; the first one is zero."""

    loss: ClassVar[Loss] = QUADRATIC

    def __init__(self, stretches: int, first_sd_rad_per_m: float, step_sd_rad_per_m: float) -> None:
        self._sd = np.array([first_sd_rad_per_m, *[step_sd_rad_per_m] * (stretches - 1)])

    def error(self, states: States) -> FloatArray:
        return np.diff(states.drift_rad_per_m, prepend=0.0)[:, None]

    def jacobian(self, states: States) -> FloatArray:
        jacobian = np.broadcast_to([[-1.0, 1.0]], (len(self._sd), 1, 2)).copy()
        jacobian[0, 0, 0] = 0.0
        return jacobian

    def columns(self, layout: Layout) -> Columns:
        own = np.arange(layout.drift, layout.wall_normals, dtype=np.int32)
        return np.stack([np.maximum(own - 1, layout.drift), own], axis=1)

    @property
    def information(self) -> FloatArray:
        information: FloatArray = (self._sd**-2)[:, None, None]
        return information
