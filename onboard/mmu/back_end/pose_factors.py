"""Factors between the poses of two keyframes: odometry, sequential scan matching, loop closure, change of heading, and
the prior of a pose that a person stated.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Pose2, wrap_angles
from onboard.mmu.back_end.factors import StoredFactors
from onboard.mmu.back_end.robust_loss import CAUCHY, DCS, QUADRATIC, Loss
from onboard.mmu.back_end.states import Columns, Layout, States

_RELATIVE_POSE = [
    ("first", np.int32),
    ("second", np.int32),
    ("measured", np.float64, 3),
    ("information", np.float64, (3, 3)),
]


class RelativePoseFactors(StoredFactors):
    """Pose of node `second` as seen from node `first`. Error: x, y (m) and heading (rad) less the measured ones."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(_RELATIVE_POSE, align=True)

    def add(self, first: int, second: int, measured: Pose2, information: FloatArray) -> None:
        """`information` (3, 3) in the frame of `first`."""
        self._append(first, second, measured.as_array(), information)

    def error(self, states: States) -> FloatArray:
        error: FloatArray = relative_poses(self.rows, states) - self.rows["measured"]
        error[:, 2] = wrap_angles(error[:, 2])
        return error

    def jacobian(self, states: States) -> FloatArray:
        return relative_pose_jacobian(self.rows, states)

    def columns(self, layout: Layout) -> Columns:
        return np.concatenate([layout.pose(self.rows["first"]), layout.pose(self.rows["second"])], axis=1)


class SequentialMatchFactors(RelativePoseFactors):
    """The newest stretch, registered onto the one before it: seldom wrong, never by much."""

    loss = CAUCHY


class LoopClosureFactors(RelativePoseFactors):
    """A place visited before: where it is a wrong one, the factor must not bend the map."""

    loss = DCS


class StatedPoseFactors(RelativePoseFactors):
    """Where a person says that the robot stands: a prior, which loop closures outvote where it is wrong."""

    loss = DCS


class OdometryFactors(StoredFactors):
    """Relative pose by dead reckoning, less its systematic errors: scale of the wheels, scale of turns, drift."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(
        [*_RELATIVE_POSE, ("path_m", np.float64), ("turn_rad", np.float64), ("stretch", np.int32)], align=True
    )
    loss = QUADRATIC

    def add(
        self,
        first: int,
        second: int,
        measured: Pose2,
        information: FloatArray,
        path_m: float = 0.0,
        turn_rad: float = 0.0,
        stretch: int = 0,
    ) -> None:
        """`path_m` and `turn_rad`: what was driven in between, zero where it was not; `information` (3, 3)."""
        self._append(first, second, measured.as_array(), information, path_m, turn_rad, stretch)

    def error(self, states: States) -> FloatArray:
        error = relative_poses(self.rows, states) - self._expected(states)
        error[:, 2] = wrap_angles(error[:, 2])
        return error

    def jacobian(self, states: States) -> FloatArray:
        rows = self.rows
        expected = self._expected(states)
        one, zero = np.ones(len(rows)), np.zeros(len(rows))
        by_bend = np.stack([0.5 * expected[:, 1], -0.5 * expected[:, 0], -one], axis=1)
        share = (self._driven / (1.0 + self._driven * states.wheel_scale_error))[:, None]
        by_scale = np.stack([-expected[:, 0], -expected[:, 1], zero], axis=1) * share
        by_turn, by_drift = by_bend * rows["turn_rad"][:, None], by_bend * rows["path_m"][:, None]
        calibration = np.stack([by_scale, by_turn, by_drift], axis=2)
        return np.concatenate([relative_pose_jacobian(rows, states), calibration], axis=2)

    def columns(self, layout: Layout) -> Columns:
        rows = self.rows
        scales = np.full((len(rows), 1), layout.wheel_scale_error) + np.arange(2)
        poses = layout.pose(rows["first"]), layout.pose(rows["second"])
        return np.concatenate([*poses, scales, layout.drift + rows["stretch"][:, None]], axis=1, dtype=np.int32)

    def _expected(self, states: States) -> FloatArray:
        """(F, 3): the measured poses as they are once the calibration is applied."""
        rows = self.rows
        bend_rad = rows["turn_rad"] * states.turn_scale_error
        bend_rad = bend_rad + rows["path_m"] * states.drift_rad_per_m[rows["stretch"]]
        expected = _bent(rows["measured"], bend_rad)
        expected[:, :2] *= 1.0 + (self._driven * states.wheel_scale_error)[:, None]
        return expected

    @property
    def _driven(self) -> FloatArray:
        """(F,) 1 where the wheels measured the path."""
        driven: FloatArray = (self.rows["path_m"] > 0.0).astype(np.float64)
        return driven


class HeadingChangeFactors(StoredFactors):
    """By how much the robot turned between two nodes, as the walls beside the path show it. Error: rad."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(
        [("first", np.int32), ("second", np.int32), ("turn_rad", np.float64), ("information", np.float64, (1, 1))],
        align=True,
    )
    loss: ClassVar[Loss] = CAUCHY

    def add(self, first: int, second: int, turn_rad: float, sd_rad: float) -> None:
        self._append(first, second, turn_rad, sd_rad**-2)

    def error(self, states: States) -> FloatArray:
        rows, heading = self.rows, states.poses[:, 2]
        return wrap_angles(heading[rows["second"]] - heading[rows["first"]] - rows["turn_rad"])[:, None]

    def jacobian(self, states: States) -> FloatArray:
        return np.broadcast_to([[-1.0, 1.0]], (len(self), 1, 2))

    def columns(self, layout: Layout) -> Columns:
        return np.concatenate([layout.heading(self.rows["first"]), layout.heading(self.rows["second"])], axis=1)


def relative_poses(rows: npt.NDArray[Any], states: States) -> FloatArray:
    """Poses (F, 3) of the nodes `second` as seen from the nodes `first`, their headings not wrapped."""
    a, b = states.poses[rows["first"]], states.poses[rows["second"]]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.stack([c * dx + s * dy, -s * dx + c * dy, b[:, 2] - a[:, 2]], axis=1)


def relative_pose_jacobian(rows: npt.NDArray[Any], states: States) -> FloatArray:
    """(F, 3, 6): derivatives of `relative_poses` by the poses `first` and `second`."""
    a, b = states.poses[rows["first"]], states.poses[rows["second"]]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    jacobian = np.zeros((len(rows), 3, 6))
    jacobian[:, 0, :5] = np.stack([-c, -s, -s * dx + c * dy, c, s], axis=1)
    jacobian[:, 1, :5] = np.stack([s, -c, -c * dx - s * dy, -s, c], axis=1)
    jacobian[:, 2, 2], jacobian[:, 2, 5] = -1.0, 1.0
    return jacobian


def _bent(relative: FloatArray, bend_rad: FloatArray) -> FloatArray:
    """Relative poses (F, 3) whose path turned evenly by `bend_rad` (F,) more than measured."""
    c, s = np.cos(bend_rad / 2), np.sin(bend_rad / 2)
    x, y = relative[:, 0], relative[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, relative[:, 2] + bend_rad], axis=1)
