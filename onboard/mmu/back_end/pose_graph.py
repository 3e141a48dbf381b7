"""Pose graph: keyframes as nodes, factors of every class between them, and the calibration states of odometry.

Besides the poses it estimates the directions of straight walls and odometry's systematic errors. Node 0 stays in its
place; the map as a whole, once it is one, keeps its direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import atan2, cos, radians, sin

import numpy as np

from common.geometry import FloatArray, Pose2, wrap_angles
from onboard.mmu.back_end.calibration_priors import CalibrationPrior
from onboard.mmu.back_end.factors import StoredFactors
from onboard.mmu.back_end.gauss_newton import Problem
from onboard.mmu.back_end.pose_factors import (
    HeadingChangeFactors,
    LoopClosureFactors,
    OdometryFactors,
    SequentialMatchFactors,
    StatedPoseFactors,
)
from onboard.mmu.back_end.robust_loss import PHI
from onboard.mmu.back_end.states import Calibration, States
from onboard.mmu.back_end.wall_factors import OrthogonalityFactors, RangeToWallFactors, WallDirectionFactors
from onboard.mmu.map.growing_rows import GrowingRows

# How well the first heading is known: it counts as a keyframe so far away that drift would turn the path there by this
# much. The sensitivity was not measured
FIRST_HEADING_RAD = radians(1.56)

Mark = tuple[int, ...]  # how many factors of each class of constraints there were


class PoseGraph:
    """A public member for each class of factors, which are added there, and `calibration`, its states besides poses."""

    def __init__(self, prior: CalibrationPrior) -> None:
        self._poses = GrowingRows(shape=(3,))
        self._covariance = 0, np.zeros((3, 3))  # of which node, as the graph last settled, or by odometry since
        self.prior = prior
        self.calibration = Calibration()
        self.odometry = OdometryFactors()
        self.sequential_matches = SequentialMatchFactors()
        self.heading_changes = HeadingChangeFactors()
        self.loop_closures = LoopClosureFactors()
        self.stated_poses = StatedPoseFactors()
        self.wall_directions = WallDirectionFactors()
        self.orthogonality = OrthogonalityFactors()
        self.ranges_to_wall = RangeToWallFactors()

    @property
    def constraints(self) -> tuple[StoredFactors, ...]:
        """All but odometry: what may pull at the path that was driven."""
        matches = self.sequential_matches, self.heading_changes, self.loop_closures, self.stated_poses
        return *matches, self.wall_directions, self.orthogonality, self.ranges_to_wall

    def __len__(self) -> int:
        return len(self._poses)

    def add_node(self, pose: Pose2) -> int:
        self._poses.append([pose.as_array()])
        return len(self._poses) - 1

    def begin_stretch(self, stretch: int) -> None:
        """Its drift continues that of the stretch before, or begins at zero, until walls show another one."""
        drift = self.calibration.drift_rad_per_m
        while len(drift) <= stretch:
            drift = np.append(drift, 0.0 if self.prior.drift_step_rad_per_m is None else drift[-1])
        self.calibration = replace(self.calibration, drift_rad_per_m=drift)

    def add_wall(self, normal_rad: float) -> int:
        """A wall with that normal at first; returns its place in `calibration.wall_normals_rad`."""
        normals = np.append(self.calibration.wall_normals_rad, normal_rad)
        self.calibration = replace(self.calibration, wall_normals_rad=normals)
        return len(normals) - 1

    def begin_right_angles(self, direction_rad: float) -> None:
        """That is the direction of the walls at right angles at first."""
        self.calibration = replace(self.calibration, right_angles_rad=direction_rad)

    @property
    def poses(self) -> FloatArray:
        """(K, 3), a copy."""
        return self._poses.rows.copy()

    def pose(self, node: int) -> Pose2:
        return Pose2.from_array(self._poses.rows[node])

    @property
    def states(self) -> States:
        """A copy of all states."""
        return States.of(self._poses.rows, self.calibration)

    def newest_covariance(self) -> FloatArray:
        """(3, 3) of the newest pose, in the map, whose zero is node 0."""
        node, covariance = self._covariance
        for edge in self.odometry.rows[node:]:
            here, there = self._poses.rows[edge["first"]], self._poses.rows[edge["second"]]
            moved, turned = np.eye(3), np.eye(3)
            moved[:2, 2] = here[1] - there[1], there[0] - here[0]
            c, s = cos(here[2]), sin(here[2])
            turned[:2, :2] = [[c, -s], [s, c]]
            covariance = moved @ covariance @ moved.T + turned @ np.linalg.inv(edge["information"]) @ turned.T
        self._covariance = len(self) - 1, covariance
        return covariance

    def mark(self) -> Mark:
        """Names the constraints that there are now, so that those that come later are the new ones."""
        return tuple(len(group) for group in self.constraints)

    def worst_chi2(self, since: Mark) -> float:
        """How strongly the constraints that are newer than `since` pull: chi-squared of the worst one."""
        return _worst_chi2(self.constraints, self.states, since)

    def optimise(self, since: Mark | None = None) -> float:
        """Bring all states to rest; returns the largest move of a node in metres.

        `since`: which constraints are new. Where one of them stays at a large chi-squared, the graph is also settled
        with all constraints pulling in full at first, and of the two results the one that costs less is kept.
        """
        constraints = [group for group in self.constraints if len(group)]
        if len(self) < 2 or not (constraints or len(self.odometry)):
            return 0.0
        before = self.states
        groups = [group for group in (self.odometry, *constraints) if len(group)]
        problem = Problem([*groups, *self.prior.groups(before.layout)], before.layout)
        settled, covariance = problem.settle(before), problem.covariance(len(self) - 1)
        if _worst_chi2(self.constraints, settled, since) > PHI:
            # Graduated non-convexity (Yang et al. 2020)
            pulled = problem.settle(before, _worst_chi2(constraints, before))
            if problem.cost(pulled) < problem.cost(settled):
                settled, covariance = pulled, problem.covariance(len(self) - 1)
        self._covariance = len(self) - 1, covariance
        poses = _turned_least(settled.poses, before.poses, FIRST_HEADING_RAD / self.prior.drift_rad_per_m)
        self._poses.replace(poses)
        self.calibration = settled.calibration
        return float(np.hypot(*(poses - before.poses)[:, :2].T).max())


def _worst_chi2(groups: Sequence[StoredFactors], states: States, since: Mark | None = None) -> float:
    """Of the factors newer than `since`, or of all."""
    starts = since or (0,) * len(groups)
    return max(
        (
            float(group.chi2_since(states, start).max())
            for group, start in zip(groups, starts, strict=True)
            if start < len(group)
        ),
        default=0.0,
    )


def _turned_least(poses: FloatArray, before: FloatArray, first_m: float) -> FloatArray:
    """Poses (K, 3) turned about the first one's place so that, as a whole, they lie as they did `before`.

    The direction of the map relative to the first heading is the graph's least certain part. Whoever drives by the map,
    or compares it with an earlier one, is better off when it does not turn with every new estimate. While the map is
    small it turns little, and the first heading stays: it counts as a keyframe at a distance of `first_m`.
    """
    here, there = poses[:, :2] - poses[0, :2], before[:, :2] - poses[0, :2]
    first_rad = float(before[0, 2] - poses[0, 2])
    sine = float((here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]).sum()) + first_m**2 * sin(first_rad)
    turn_rad = atan2(sine, float((here * there).sum()) + first_m**2 * cos(first_rad))
    c, s = cos(turn_rad), sin(turn_rad)
    places = poses[0, :2] + here @ np.array([[c, s], [-s, c]])
    return np.column_stack([places, wrap_angles(poses[:, 2] + turn_rad)])
