"""Robust losses: what the chi-squared of a factor costs, and with which weight the factor then enters Gauss-Newton.

`phi` of a weight is the chi-squared up to which a factor counts in full. A cost always has PHI; while the graph
settles, the weights may begin with a larger one (graduated non-convexity, Yang et al. 2020).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.geometry import FloatArray

# Chi-squared (Mahalanobis distance squared) of a factor with three degrees of freedom: 95 % of the right ones are below
# 7.8. Its sensitivity was not measured
PHI = 8.0


@dataclass(frozen=True, slots=True)
class Loss:
    """`cost` of chi-squared (F,); `weight` of chi-squared (F,) and `phi`, at most 1."""

    cost: Callable[[FloatArray], FloatArray]
    weight: Callable[[FloatArray, float], FloatArray]


def _cauchy_cost(chi2: FloatArray) -> FloatArray:
    cost: FloatArray = PHI * np.log1p(chi2 / PHI)
    return cost


def _cauchy_weight(chi2: FloatArray, phi: float) -> FloatArray:
    weight: FloatArray = 1.0 / (1.0 + chi2 / phi)
    return weight


def _dcs_scale(chi2: FloatArray, phi: float) -> FloatArray:
    return np.minimum(1.0, 2 * phi / (phi + chi2))


def _dcs_cost(chi2: FloatArray) -> FloatArray:
    scale = _dcs_scale(chi2, PHI)
    cost: FloatArray = scale**2 * chi2 + PHI * (1.0 - scale) ** 2
    return cost


def _dcs_weight(chi2: FloatArray, phi: float) -> FloatArray:
    weight: FloatArray = _dcs_scale(chi2, phi) ** 2
    return weight


QUADRATIC = Loss(lambda chi2: chi2, lambda chi2, phi: np.ones_like(chi2))
CAUCHY = Loss(_cauchy_cost, _cauchy_weight)  # of what is far off now and then: quadratic first, then hardly more
# Dynamic covariance scaling (Agarwal et al. 2013): a wrong factor loses its pull, and costs PHI at most
DCS = Loss(_dcs_cost, _dcs_weight)
