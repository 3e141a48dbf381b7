"""The wall points of the map, put together from what the mapping unit publishes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.geometry import Points
from common.messages import MapUpdate


class WallPointMap:
    """All points known now, kept as they travel: eight bytes each."""

    def __init__(self) -> None:
        self._points_m: npt.NDArray[np.float32] = np.zeros((0, 2), np.float32)

    def apply(self, update: MapUpdate) -> None:
        """An increment that does not continue the points is left out until the map begins anew."""
        if update.start == 0:
            self._points_m = update.points_m
        elif update.start == len(self._points_m):
            self._points_m = np.concatenate([self._points_m, update.points_m])

    def near(self, x_m: float, y_m: float, reach_m: float) -> Points:
        """The points (N, 2) less than `reach_m` from a place along both axes."""
        x, y = self._points_m.T
        inside = (np.abs(x - np.float32(x_m)) < reach_m) & (np.abs(y - np.float32(y_m)) < reach_m)
        points: Points = self._points_m[inside].astype(np.float64)
        return points
