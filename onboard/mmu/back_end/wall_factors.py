"""Factors from straight walls: direction of a wall, orthogonality of walls, range to a wall."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from common.geometry import FloatArray, wrap_angles
from onboard.mmu.back_end.factors import StoredFactors
from onboard.mmu.back_end.pose_factors import relative_pose_jacobian, relative_poses
from onboard.mmu.back_end.robust_loss import DCS
from onboard.mmu.back_end.states import Columns, Layout, States


class WallDirectionFactors(StoredFactors):
    """A piece of a wall, seen from a node: its normal against the normal of the wall that it belongs to. Error: rad."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(
        [("node", np.int32), ("wall", np.int32), ("normal_rad", np.float64), ("information", np.float64, (1, 1))],
        align=True,
    )
    loss = DCS

    def add(self, node: int, wall: int, normal_rad: float, sd_rad: float) -> None:
        """`normal_rad` in the frame of the node."""
        self._append(node, wall, normal_rad, sd_rad**-2)

    def error(self, states: States) -> FloatArray:
        rows, heading = self.rows, states.poses[:, 2]
        expected = states.wall_normals_rad[rows["wall"]] - rows["normal_rad"]
        return wrap_angles(heading[rows["node"]] - heading[0] - expected)[:, None]

    def jacobian(self, states: States) -> FloatArray:
        return np.broadcast_to([[-1.0, 1.0, -1.0]], (len(self), 1, 3))

    def columns(self, layout: Layout) -> Columns:
        nodes, walls = self.rows["node"], self.rows["wall"]
        own = layout.heading(np.zeros_like(nodes)), layout.heading(nodes), layout.wall_normals + walls[:, None]
        return np.concatenate(own, axis=1, dtype=np.int32)


class OrthogonalityFactors(StoredFactors):
    """A wall that stands at right angles to the others (Manhattan world): its normal against theirs. Error: rad."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(
        [("wall", np.int32), ("quarters_rad", np.float64), ("information", np.float64, (1, 1))], align=True
    )
    loss = DCS

    def add(self, wall: int, quarters_rad: float, sd_rad: float) -> None:
        """`quarters_rad`: the multiple of a right angle from the Manhattan direction to the wall's normal."""
        self._append(wall, quarters_rad, sd_rad**-2)

    def error(self, states: States) -> FloatArray:
        rows = self.rows
        expected = rows["quarters_rad"] + states.right_angles_rad
        return wrap_angles(states.wall_normals_rad[rows["wall"]] - expected)[:, None]

    def jacobian(self, states: States) -> FloatArray:
        return np.broadcast_to([[-1.0, 1.0]], (len(self), 1, 2))

    def columns(self, layout: Layout) -> Columns:
        walls = layout.wall_normals + self.rows["wall"][:, None]
        return np.concatenate([np.full_like(walls, layout.right_angles), walls], axis=1, dtype=np.int32)


class RangeToWallFactors(StoredFactors):
    """How far the robot came nearer to a wall between two nodes, by its ranges to the wall. Error: m."""

    ROW: ClassVar[np.dtype[Any]] = np.dtype(
        [
            ("first", np.int32),
            ("second", np.int32),
            ("normal", np.float64, 2),
            ("distance_m", np.float64),
            ("information", np.float64, (1, 1)),
        ],
        align=True,
    )
    loss = DCS

    def add(self, first: int, second: int, normal: FloatArray, distance_m: float, sd_m: float) -> None:
        """`distance_m`: from `first` to `second` along the wall's unit `normal` (2,), in the frame of `first`."""
        self._append(first, second, normal, distance_m, sd_m**-2)

    def error(self, states: States) -> FloatArray:
        along_m = np.einsum("fi,fi->f", self.rows["normal"], relative_poses(self.rows, states)[:, :2])
        error: FloatArray = (along_m - self.rows["distance_m"])[:, None]
        return error

    def jacobian(self, states: States) -> FloatArray:
        jacobian: FloatArray = np.einsum(
            "fi,fij->fj", self.rows["normal"], relative_pose_jacobian(self.rows, states)[:, :2]
        )
        return jacobian[:, None, :]

    def columns(self, layout: Layout) -> Columns:
        return np.concatenate([layout.pose(self.rows["first"]), layout.pose(self.rows["second"])], axis=1)
