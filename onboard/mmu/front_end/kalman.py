"""filterpy's extended Kalman filter, without the scipy that its other filters need.

`import filterpy.kalman` loads scipy.stats, .ndimage, .sparse and .linalg for functions that the extended filter never
calls; the process of the front end uses no scipy otherwise.
"""

from __future__ import annotations

import numpy as np

from onboard.mmu.on_demand import on_demand

with on_demand("scipy"):
    from filterpy.kalman import EKF, ExtendedKalmanFilter


class _OneNumber:
    """What the filter needs of linear algebra: of a matrix with one number, at a tenth of the price."""

    inv = staticmethod(np.reciprocal)


EKF.linalg = _OneNumber

__all__ = ["ExtendedKalmanFilter"]
