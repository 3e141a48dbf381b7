"""Sparse Gauss-Newton over all states of the pose graph (Grisetti et al. 2010): adds up what the factors give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import SuperLU, splu

from common.geometry import FloatArray
from onboard.mmu.back_end.factors import FactorGroup, chi_squared
from onboard.mmu.back_end.robust_loss import PHI
from onboard.mmu.back_end.states import Layout, States

# Of the solver. The sensitivity was not measured
ITERATIONS = 14
GRADUATION = 3.0  # by which the robust losses' phi shrinks from one iteration to the next
AT_REST = 1e-3  # metres and radians: a step without one larger than this is the last
DAMPING = 1e-6  # information of a pose about which nothing is known; far below any factor's


class Problem:
    """Factors over so many states. Node 0 stays in its place, since only relative poses are measured."""

    def __init__(self, groups: Sequence[FactorGroup], layout: Layout) -> None:
        self._groups = groups
        self._layout = layout
        errors = [group.information.shape[:2] for group in groups]
        columns = [group.columns(layout) for group in groups]
        widths = [np.repeat(own.shape[1], f * d) for own, (f, d) in zip(columns, errors, strict=True)]
        self._columns = np.concatenate(
            [np.repeat(c, d, axis=0).ravel() for c, (_, d) in zip(columns, errors, strict=True)]
        )
        self._row_ends = np.concatenate([[0], np.cumsum(np.concatenate(widths))]).astype(np.int32)
        damping = np.zeros(layout.size)
        damping[: layout.pose_end] = DAMPING
        self._damping = diags(damping, format="csr")
        self._factorised: SuperLU | None = None  # of the newest step, without node 0

    def settle(self, states: States, phi: float = PHI) -> States:
        """At rest, from these states on; `phi`: with which the robust losses begin, at least PHI."""
        phi = max(phi, PHI)
        for _ in range(ITERATIONS):
            step = self._step(states, phi)
            states = states.moved(step)
            if np.abs(step[: self._layout.pose_end]).max() < AT_REST and phi == PHI:
                break
            phi = max(phi / GRADUATION, PHI)
        return states

    def covariance(self, node: int) -> FloatArray:
        """(3, 3) of that pose where the newest step began, which is at rest by now: a marginal of the whole."""
        if self._factorised is None or node == 0:
            return np.zeros((3, 3))
        at = 3 * (node - 1)
        unit = np.zeros((self._layout.size - 3, 3))
        unit[at : at + 3] = np.eye(3)
        marginal: FloatArray = self._factorised.solve(unit)[at : at + 3]
        return marginal

    def cost(self, states: States) -> float:
        """What is minimised."""
        return float(sum(group.loss.cost(group.chi2(states)).sum() for group in self._groups))

    def _step(self, states: States, phi: float) -> FloatArray:
        """(`layout.size`,) to the minimum of the linearised problem."""
        errors, jacobians, weighted = [], [], []
        for group in self._groups:
            error, jacobian, information = group.error(states), group.jacobian(states), group.information
            weight = group.loss.weight(chi_squared(error, information), phi)
            errors.append(error.ravel())
            jacobians.append(jacobian.ravel())
            weighted.append(np.einsum("fij,f,fjk->fik", information, weight, jacobian).ravel())
        left, right = self._sparse(weighted), self._sparse(jacobians)
        gradient = left.T @ np.concatenate(errors)
        hessian = left.T @ right + self._damping
        step = np.zeros(self._layout.size)
        # Ordered as a symmetric matrix: half the time and 10 MB less than the default at a thousand poses
        self._factorised = splu(hessian.tocsc()[3:, 3:], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        step[3:] = self._factorised.solve(-gradient[3:])
        return step

    def _sparse(self, rows: list[FloatArray]) -> csr_matrix:
        """A row for each error, a column for each state."""
        shape = len(self._row_ends) - 1, self._layout.size
        return csr_matrix((np.concatenate(rows), self._columns, self._row_ends), shape=shape)
