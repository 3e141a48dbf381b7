"""Pose graph: key frames joined by what odometry and matches say of their relative poses.

Sparse Gauss-Newton (Grisetti et al. 2010); closures carry robust weights (dynamic covariance scaling, Agarwal et al.
2013), so that a wrong one loses its pull instead of bending the map. Node 0 is held.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from common.geometry import FloatArray, Pose2, wrap_angles

DCS_PHI = 8.0
ITERATIONS = 6


@dataclass(frozen=True, slots=True)
class Edge:
    """Pose of node `second` as seen from node `first`, with its information matrix (3, 3)."""

    first: int
    second: int
    relative: Pose2
    information: FloatArray
    closure: bool


@dataclass(slots=True)
class PoseGraph:
    """`poses` (K, 3) are the best estimates in the map."""

    edges: list[Edge] = field(default_factory=list)
    _poses: list[FloatArray] = field(default_factory=list)

    def add_node(self, pose: Pose2) -> int:
        self._poses.append(pose.as_array())
        return len(self._poses) - 1

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses(self) -> FloatArray:
        return np.array(self._poses).reshape(-1, 3)

    def pose(self, node: int) -> Pose2:
        return Pose2.from_array(self._poses[node])

    def strain(self, start: int) -> float:
        """The largest chi squared among the edges from the `start`-th on."""
        worst = 0.0
        for edge in self.edges[start:]:
            error = edge.relative.between(self.pose(edge.first).between(self.pose(edge.second))).as_array()
            worst = max(worst, float(error @ edge.information @ error))
        return worst

    def optimise(self) -> float:
        """Bring all poses to rest; returns the largest move of a node in metres."""
        if len(self._poses) < 2 or not self.edges:
            return 0.0
        first = np.array([e.first for e in self.edges])
        second = np.array([e.second for e in self.edges])
        measured = np.array([e.relative.as_array() for e in self.edges])
        information = np.array([e.information for e in self.edges])
        robust = np.array([e.closure for e in self.edges])
        before = self.poses
        poses = before.copy()
        for _ in range(ITERATIONS):
            step = _gauss_newton_step(poses, first, second, measured, information, robust)
            poses += step
            if np.abs(step).max() < 1e-3:
                break
        poses[:, 2] = wrap_angles(poses[:, 2])
        self._poses = list(poses)
        return float(np.hypot(*(poses - before)[:, :2].T).max())


def _gauss_newton_step(
    poses: FloatArray,
    first: np.ndarray,
    second: np.ndarray,
    measured: FloatArray,
    information: FloatArray,
    robust: np.ndarray,
) -> FloatArray:
    a, b = poses[first], poses[second]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    error = np.stack([c * dx + s * dy, -s * dx + c * dy, b[:, 2] - a[:, 2]], axis=1) - measured
    error[:, 2] = wrap_angles(error[:, 2])
    chi2 = np.einsum("ei,eij,ej->e", error, information, error)
    scale = np.where(robust, np.minimum(1.0, 2 * DCS_PHI / (DCS_PHI + chi2)), 1.0) ** 2
    weighted = information * scale[:, None, None]
    n, zero, one = len(first), np.zeros(len(first)), np.ones(len(first))
    ja = np.stack(
        [
            np.stack([-c, -s, -s * dx + c * dy], axis=1),
            np.stack([s, -c, -c * dx - s * dy], axis=1),
            np.stack([zero, zero, -one], axis=1),
        ],
        axis=1,
    )
    jb = np.stack(
        [np.stack([c, s, zero], axis=1), np.stack([-s, c, zero], axis=1), np.stack([zero, zero, one], axis=1)], axis=1
    )
    blocks, rows, columns = [], [], []
    gradient = np.zeros((len(poses), 3))
    for node_i, ji in ((first, ja), (second, jb)):
        left = np.einsum("eki,ekl->eil", ji, weighted)
        np.add.at(gradient, node_i, np.einsum("eil,el->ei", left, error))
        for node_j, jj in ((first, ja), (second, jb)):
            blocks.append(np.einsum("eil,elj->eij", left, jj))
            rows.append(np.broadcast_to((3 * node_i)[:, None, None] + np.arange(3)[None, :, None], (n, 3, 3)))
            columns.append(np.broadcast_to((3 * node_j)[:, None, None] + np.arange(3)[None, None, :], (n, 3, 3)))
    size = 3 * len(poses)
    values = np.concatenate([x.ravel() for x in blocks])
    hessian = coo_matrix(
        (values, (np.concatenate([r.ravel() for r in rows]), np.concatenate([q.ravel() for q in columns]))),
        shape=(size, size),
    ).tocsc()[3:, 3:]
    solution = splu(hessian).solve(-gradient.ravel()[3:])
    return np.concatenate([np.zeros(3), solution]).reshape(-1, 3)
