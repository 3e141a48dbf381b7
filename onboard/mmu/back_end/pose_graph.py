"""Pose graph: key frames joined by what odometry and matches say of their relative poses.

Sparse Gauss-Newton (Grisetti et al. 2010) over all poses, the directions of straight walls, and the odometry's slow
errors: by what share every way is longer than the wheels say, how much it turns away per radian turned, and per metre,
which wanders (a gyro's bias does) and so has a value for every few metres. Ties to walls carry robust weights (dynamic
covariance scaling, Agarwal et al. 2013), so that a wrong one loses its pull instead of bending the map, and gets it
back should the graph come to agree with it. Node 0 stays in its place; the map as a whole, once it is one, keeps its
direction.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan2, cos, radians, sin
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import block_diag, csr_matrix, diags, identity
from scipy.sparse.linalg import splu

from common.geometry import FloatArray, Pose2, wrap_angles
from onboard.mmu.back_end.factors import EdgeStore, Kind
from onboard.mmu.map.growing_rows import GrowingRows

DCS_PHI = 8.0
ITERATIONS = 14
EASING = 3.0
AT_REST = 1e-3
FIRST_HEADING_RAD = radians(1.56)  # it counts as a key frame so far away that drift would turn the way there by this
# In `slow`: m/m, rad/rad, the direction (rad) of walls that stand at right angles, then rad/m of each stretch
LENGTH, TURN, WALLS, PER_M = range(4)
UNKNOWN_SD_RAD = 100.0  # of a direction of which nothing is known beforehand


@dataclass(frozen=True, slots=True)
class DriftPrior:
    """How far the odometry's slow errors may reach, as standard deviations."""

    rad_per_m: float
    # From one stretch to the next. None: every stretch begins anew, as after a gyro's rest; now and then a gyro is far
    # worse than its kind, and then straight walls tell
    rad_per_m_step: float | None
    rad_per_rad: float
    m_per_m: float


@dataclass(slots=True)
class PoseGraph:
    """`poses` (K, 3) are the best estimates in the map, `slow` (3 + stretches,) those of what hardly changes.

    `walls_rad` (W,) are those of the walls' normals, to the heading of node 0.
    """

    prior: DriftPrior
    edges: EdgeStore = field(default_factory=EdgeStore)
    slow: FloatArray = field(default_factory=lambda: np.zeros(PER_M + 1))
    walls_rad: FloatArray = field(default_factory=lambda: np.zeros(0))
    _poses: GrowingRows = field(default_factory=lambda: GrowingRows(shape=(3,)))

    def add_node(self, pose: Pose2) -> int:
        self._poses.append([pose.as_array()])
        return len(self._poses) - 1

    def __len__(self) -> int:
        return len(self._poses)

    def begin_stretch(self, stretch: int) -> None:
        """The value per metre goes on from the one before, or begins anew, until the walls say otherwise."""
        while len(self.slow) < PER_M + stretch + 1:
            self.slow = np.append(self.slow, 0.0 if self.prior.rad_per_m_step is None else self.slow[-1])

    def add_wall(self, normal_rad: float) -> int:
        """A wall whose normal pieces of it will tell better; returns its place in `walls_rad`."""
        self.walls_rad = np.append(self.walls_rad, normal_rad)
        return len(self.walls_rad) - 1

    @property
    def poses(self) -> FloatArray:
        return self._poses.rows.copy()

    def pose(self, node: int) -> Pose2:
        return Pose2.from_array(self._poses.rows[node])

    def strain(self, start: int = 0) -> FloatArray:
        """How strongly each edge from the `start`-th on pulls: chi squared (E,), zero for odometry."""
        if start == len(self.edges):
            return np.zeros(0)
        system = _System(self.edges.rows[start:], len(self), len(self.slow), len(self.walls_rad), self.prior)
        return system.strain(self._poses.rows, self._values)

    @property
    def _values(self) -> FloatArray:
        return np.concatenate([self.slow, self.walls_rad])

    def optimise(self, since: int = 0) -> float:
        """Bring all poses to rest; returns the largest move of a node in metres.

        `since`: from which edge on a tie that stays strained may pull the graph over.
        """
        if len(self) < 2 or not len(self.edges):
            return 0.0
        before, values = self.poses, self._values
        system = _System(self.edges.rows, len(before), len(self.slow), len(self.walls_rad), self.prior)
        poses, settled = system.settle(before, values, DCS_PHI)
        if system.strain(poses, settled)[since:].max(initial=0.0) > DCS_PHI:
            # Graduated non-convexity (Yang et al. 2020): first everything pulls, then what stays strained lets go
            pulled = system.settle(before, values, float(system.strain(before, values).max()))
            if system.cost(*pulled) < system.cost(poses, settled):
                poses, settled = pulled
        poses = _turned_least(poses, before, FIRST_HEADING_RAD / self.prior.rad_per_m)
        self._poses.replace(poses)
        self.slow, self.walls_rad = np.split(settled, [len(self.slow)])
        return float(np.hypot(*(poses - before)[:, :2].T).max())


class _System:
    """Rows (E,) of an `EdgeStore` over so many poses, slow values and walls, and one Gauss-Newton step on them."""

    def __init__(self, edges: npt.NDArray[Any], count: int, slow: int, walls: int, prior: DriftPrior) -> None:
        self.first, self.second, self.kind = edges["first"], edges["second"], edges["kind"]
        self.measured, self.information = edges["relative"], edges["information"]
        way_m = edges["way_m"]
        piece, upright = self.kind == Kind.BEARING.value, self.kind == Kind.UPRIGHT.value
        self.driven = np.stack([edges["turn_rad"], upright, way_m + piece - upright], axis=1)
        self.slot = edges["slot"] + np.where(piece | upright, slow, PER_M)
        self.wheeled = (way_m > 0.0).astype(np.float64)
        self.size = 3 * count
        self.values = slow + walls
        nodes = [3 * node[:, None] + np.arange(3) for node in (self.first, self.second)]
        seldom = np.full((len(edges), 1), self.size) + np.arange(PER_M)
        columns = np.concatenate([*nodes, seldom, self.size + self.slot[:, None]], axis=1, dtype=np.int32)
        self.columns = np.repeat(columns, 3, axis=0).ravel()
        self.beliefs, self.rare = _beliefs(prior, slow, walls)

    def settle(self, poses: FloatArray, values: FloatArray, phi: float) -> tuple[FloatArray, FloatArray]:
        """At rest from these poses (K, 3) on; `phi`: the strain up to which ties pull fully, eased down to DCS_PHI."""
        phi = max(phi, DCS_PHI)
        for _ in range(ITERATIONS):
            step, values_step = self._step(poses, values, phi)
            poses, values = poses + step, values + values_step
            if np.abs(step).max() < AT_REST and phi == DCS_PHI:
                break
            phi = max(phi / EASING, DCS_PHI)
        return poses, values

    def strain(self, poses: FloatArray, values: FloatArray) -> FloatArray:
        """Chi squared (E,) of every tie; zero for odometry."""
        return np.where(self.kind == Kind.ODOMETRY.value, 0.0, self._chi2(self._linearise(poses, values)[0]))

    def cost(self, poses: FloatArray, values: FloatArray) -> float:
        """What is minimised: a tie that is not believed at all costs DCS_PHI."""
        chi2 = self._chi2(self._linearise(poses, values)[0])
        scale = np.minimum(1.0, 2 * DCS_PHI / (DCS_PHI + chi2))
        scaled = scale**2 * chi2 + DCS_PHI * (1.0 - scale) ** 2
        off2 = (self.beliefs @ values) ** 2
        believed = np.where(self.rare, _rare_cost(off2), off2)
        return float(self._by_kind(chi2, _rare_cost(chi2), scaled).sum() + believed.sum())

    def _chi2(self, error: FloatArray) -> FloatArray:
        chi2: FloatArray = np.einsum("ei,eij,ej->e", error, self.information, error)
        return chi2

    def _by_kind(self, driven: FloatArray, near: FloatArray, tie: FloatArray) -> FloatArray:
        """Each edge's value (E,): of odometry, of a near tie, of any other tie."""
        return np.where(self.kind == Kind.ODOMETRY.value, driven, np.where(self.kind == Kind.NEAR.value, near, tie))

    def _step(self, poses: FloatArray, values: FloatArray, phi: float) -> tuple[FloatArray, FloatArray]:
        """Moves of all poses (K, 3) and of the other values."""
        error, ja, jb, jd = self._linearise(poses, values)
        jacobian = np.concatenate([ja, jb, jd], axis=2)
        weighted = np.einsum("eij,e,ejk->eik", self.information, self._trust(self._chi2(error), phi), jacobian)
        left, right = self._sparse(weighted), self._sparse(jacobian)
        gradient = left.T @ error.ravel()
        trust = np.where(self.rare, _rare_trust((self.beliefs @ values) ** 2, phi), 1.0)
        prior = self.beliefs.T @ diags(trust) @ self.beliefs
        gradient[self.size :] += prior @ values
        hessian = left.T @ right + block_diag([identity(self.size) * 1e-6, prior], format="csr")
        solution = np.zeros(self.size + self.values)
        # Ordered as a symmetric matrix: half the time and 10 MB less than the default at a thousand poses
        factors = splu(hessian.tocsc()[3:, 3:], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        solution[3:] = factors.solve(-gradient[3:])
        return solution[: self.size].reshape(-1, 3), solution[self.size :]

    def _sparse(self, rows: FloatArray) -> csr_matrix:
        """Three rows of every edge (E, 3, 10): its two nodes, then the other values, at the end of the state."""
        ends = np.arange(0, rows.size + 1, rows.shape[2], dtype=np.int32)
        return csr_matrix((rows.ravel(), self.columns, ends), shape=(3 * len(rows), self.size + self.values))

    def _linearise(
        self, poses: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        a, b = poses[self.first], poses[self.second]
        c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        bent = self.driven[:, :2] @ values[TURN:PER_M] + self.driven[:, 2] * values[self.slot]
        longer = self.wheeled * values[LENGTH]
        expected = _bent(self.measured, bent)
        expected[:, :2] *= 1.0 + longer[:, None]
        error = np.stack([c * dx + s * dy, -s * dx + c * dy, b[:, 2] - a[:, 2]], axis=1) - expected
        error[:, 2] = wrap_angles(error[:, 2])
        zero, one = np.zeros(len(a)), np.ones(len(a))
        ja = np.stack(
            [
                np.stack([-c, -s, -s * dx + c * dy], axis=1),
                np.stack([s, -c, -c * dx - s * dy], axis=1),
                np.stack([zero, zero, -one], axis=1),
            ],
            axis=1,
        )
        jb = np.stack(
            [np.stack([c, s, zero], axis=1), np.stack([-s, c, zero], axis=1), np.stack([zero, zero, one], axis=1)],
            axis=1,
        )
        by_bend = np.stack([0.5 * expected[:, 1], -0.5 * expected[:, 0], -one], axis=1)
        by_length = (
            np.stack([-expected[:, 0], -expected[:, 1], zero], axis=1) * (self.wheeled / (1.0 + longer))[:, None]
        )
        by_values = np.concatenate([by_length[:, :, None], by_bend[:, :, None] * self.driven[:, None, :]], axis=2)
        return error, ja, jb, by_values

    def _trust(self, chi2: FloatArray, phi: float) -> FloatArray:
        scaled = np.minimum(1.0, 2 * phi / (phi + chi2)) ** 2
        return self._by_kind(np.ones_like(chi2), _rare_trust(chi2, phi), scaled)


def _beliefs(prior: DriftPrior, slow: int, walls: int) -> tuple[csr_matrix, npt.NDArray[np.bool_]]:
    """What is known beforehand of the other values, and what of it (R,) is far off now and then.

    Rows (R, slow and walls): such a row times the values has variance 1.
    """
    stretches = slow - PER_M
    errors = [prior.m_per_m, prior.rad_per_rad, UNKNOWN_SD_RAD, *stretches * [prior.rad_per_m]]
    information = 1.0 / np.array([*errors, *walls * [UNKNOWN_SD_RAD]])
    less_the_last = np.zeros(len(information) - 1)
    row = np.arange(slow + walls)
    rare = (row >= PER_M) & (row < slow)
    if prior.rad_per_m_step is not None:
        information[PER_M + 1 : slow] = 1.0 / prior.rad_per_m_step
        less_the_last[PER_M : slow - 1] = -1.0 / prior.rad_per_m_step
        rare[:] = False
    return diags([information, less_the_last], [0, -1], format="csr"), rare


def _rare_cost(chi2: FloatArray) -> FloatArray:
    """Of what is far off now and then (Cauchy's loss): quadratic first, and soon hardly more."""
    cost: FloatArray = DCS_PHI * np.log1p(chi2 / DCS_PHI)
    return cost


def _rare_trust(chi2: FloatArray, phi: float) -> FloatArray:
    """The weight that belongs to `_rare_cost`."""
    trust: FloatArray = 1.0 / (1.0 + chi2 / phi)
    return trust


def _turned_least(poses: FloatArray, before: FloatArray, first_m: float) -> FloatArray:
    """Poses (K, 3) turned about the first one's place so that, as a whole, they lie as they did `before`.

    How the map lies to the first heading is the graph's least certain part: whoever drives by the map, and whoever
    compares it with yesterday's, is better off when it does not swing round with every change of mind about that. While
    the map is small it swings by little, and the first heading is what stays: it counts as a key frame at `first_m`.
    """
    here, there = poses[:, :2] - poses[0, :2], before[:, :2] - poses[0, :2]
    first_rad = float(before[0, 2] - poses[0, 2])
    sine = float((here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]).sum()) + first_m**2 * sin(first_rad)
    turn_rad = atan2(sine, float((here * there).sum()) + first_m**2 * cos(first_rad))
    c, s = cos(turn_rad), sin(turn_rad)
    places = poses[0, :2] + here @ np.array([[c, s], [-s, c]])
    return np.column_stack([places, wrap_angles(poses[:, 2] + turn_rad)])


def _bent(relative: FloatArray, bend_rad: FloatArray) -> FloatArray:
    """Relative poses (E, 3) whose way turned by `bend_rad` (E,) more than odometry says."""
    c, s = np.cos(bend_rad / 2), np.sin(bend_rad / 2)
    x, y = relative[:, 0], relative[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, relative[:, 2] + bend_rad], axis=1)
