"""What every factor of the pose graph is: an error of some states, its Jacobian, its information and its loss.

Factors of one class lie together in arrays, F of them with D errors and C states each, so that a thousand cost little
more than one. `pose_factors`, `wall_factors` and `calibration_priors` have the classes; `gauss_newton` adds them up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray
from onboard.mmu.back_end.robust_loss import Loss
from onboard.mmu.back_end.states import Columns, Layout, States
from onboard.mmu.map.growing_rows import GrowingRows


class FactorGroup(ABC):
    """All factors of one class."""

    loss: ClassVar[Loss]

    @abstractmethod
    def error(self, states: States) -> FloatArray:
        """(F, D): what the factors measured, and how far the states are off it."""

    @abstractmethod
    def jacobian(self, states: States) -> FloatArray:
        """(F, D, C): derivatives of the error by the states in `columns`."""

    @abstractmethod
    def columns(self, layout: Layout) -> Columns:
        """(F, C): which states the error depends on."""

    @property
    @abstractmethod
    def information(self) -> FloatArray:
        """(F, D, D): inverse covariance of the error."""

    def chi2(self, states: States) -> FloatArray:
        """(F,): squared Mahalanobis distance of each factor."""
        return chi_squared(self.error(states), self.information)


class StoredFactors(FactorGroup):
    """Factors that are added one by one, as rows of the type ROW, which has a field `information`."""

    ROW: ClassVar[np.dtype[Any]]

    def __init__(self) -> None:
        self._kept = GrowingRows(self.ROW)

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def rows(self) -> npt.NDArray[Any]:
        """(F,) in the order in which they were added."""
        return self._kept.rows

    @property
    def information(self) -> FloatArray:
        information: FloatArray = self.rows["information"]
        return information

    def chi2_since(self, states: States, start: int) -> FloatArray:
        """(F,) of those from the `start`-th on."""
        newest = type(self)()
        newest._kept = GrowingRows(self.ROW, capacity=0)
        newest._kept.append(self.rows[start:])
        return newest.chi2(states)

    def _append(self, *row: object) -> None:
        self._kept.append(np.array([row], self.ROW))


def chi_squared(error: FloatArray, information: FloatArray) -> FloatArray:
    """(F,) of errors (F, D) with information (F, D, D)."""
    chi2: FloatArray = np.einsum("fi,fij,fj->f", error, information, error)
    return chi2
