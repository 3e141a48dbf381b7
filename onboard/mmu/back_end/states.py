"""States of the pose graph: the poses of all keyframes, and the calibration states by their names."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray

Columns = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Systematic errors of odometry, and directions of walls. All directions are relative to the heading of node 0.

    The drift has a value for every stretch of the path, because a gyro's bias wanders.
    """

    wheel_scale_error: float = 0.0  # m/m: by what share a path is longer than the wheels measure
    turn_scale_error: float = 0.0  # rad/rad: how much the robot turns in addition, per radian measured
    right_angles_rad: float = 0.0  # direction of the walls that stand at right angles (Manhattan directions)
    drift_rad_per_m: FloatArray = field(default_factory=lambda: np.zeros(1))  # (S,): turn in addition, per metre driven
    wall_normals_rad: FloatArray = field(default_factory=lambda: np.zeros(0))  # (W,)


@dataclass(frozen=True, slots=True)
class Layout:
    """In which column of the linear system each state stands: three per pose, then the calibration states."""

    poses: int
    stretches: int
    walls: int

    def pose(self, nodes: npt.NDArray[np.integer[Any]]) -> Columns:
        """(N, 3) for x, y and heading of nodes (N,)."""
        return (3 * nodes[:, None] + np.arange(3)).astype(np.int32)

    def heading(self, nodes: npt.NDArray[np.integer[Any]]) -> Columns:
        """(N, 1) for nodes (N,)."""
        return (3 * nodes[:, None] + 2).astype(np.int32)

    @property
    def pose_end(self) -> int:
        """How many columns the poses take."""
        return 3 * self.poses

    @property
    def wheel_scale_error(self) -> int:
        return self.pose_end

    @property
    def turn_scale_error(self) -> int:
        return self.pose_end + 1

    @property
    def right_angles(self) -> int:
        return self.pose_end + 2

    @property
    def drift(self) -> int:
        """Of the first stretch."""
        return self.pose_end + 3

    @property
    def wall_normals(self) -> int:
        """Of the first wall."""
        return self.drift + self.stretches

    @property
    def size(self) -> int:
        return self.wall_normals + self.walls


@dataclass(frozen=True, slots=True)
class States:
    """All states as one vector (`layout.size`,)."""

    vector: FloatArray
    layout: Layout

    @classmethod
    def of(cls, poses: FloatArray, calibration: Calibration) -> States:
        """Poses (K, 3) and calibration."""
        scalars = [calibration.wheel_scale_error, calibration.turn_scale_error, calibration.right_angles_rad]
        parts = poses.ravel(), scalars, calibration.drift_rad_per_m, calibration.wall_normals_rad
        layout = Layout(len(poses), len(calibration.drift_rad_per_m), len(calibration.wall_normals_rad))
        return cls(np.concatenate(parts), layout)

    def moved(self, step: FloatArray) -> States:
        """By a step (`layout.size`,)."""
        return States(self.vector + step, self.layout)

    @property
    def poses(self) -> FloatArray:
        """(K, 3), a view."""
        return self.vector[: self.layout.pose_end].reshape(-1, 3)

    @property
    def wheel_scale_error(self) -> float:
        return float(self.vector[self.layout.wheel_scale_error])

    @property
    def turn_scale_error(self) -> float:
        return float(self.vector[self.layout.turn_scale_error])

    @property
    def right_angles_rad(self) -> float:
        return float(self.vector[self.layout.right_angles])

    @property
    def drift_rad_per_m(self) -> FloatArray:
        return self.vector[self.layout.drift : self.layout.wall_normals]

    @property
    def wall_normals_rad(self) -> FloatArray:
        return self.vector[self.layout.wall_normals :]

    @property
    def calibration(self) -> Calibration:
        """A copy."""
        return Calibration(
            self.wheel_scale_error,
            self.turn_scale_error,
            self.right_angles_rad,
            self.drift_rad_per_m.copy(),
            self.wall_normals_rad.copy(),
        )
