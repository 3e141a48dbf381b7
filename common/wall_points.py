"""The wall points of the map, put together from what the mapping unit publishes."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
import numpy.typing as npt

from common.geometry import Points
from common.messages.mapping import MapUpdate

_MARGIN_M = 1.0  # a place that moves less needs no look at all points


@dataclass(frozen=True, slots=True)
class _Around:
    """The points less than `reach_m` from a place along both axes."""

    x_m: float
    y_m: float
    reach_m: float
    points_m: npt.NDArray[np.float32]


class WallPointMap:
    """All points known now, kept as they travel: eight bytes each."""

    def __init__(self) -> None:
        self._points_m: npt.NDArray[np.float32] = np.zeros((0, 2), np.float32)
        self._around = _Around(0.0, 0.0, -inf, self._points_m)

    def apply(self, update: MapUpdate) -> None:
        """An increment that does not continue the points is left out until the map begins anew."""
        if update.start == 0:
            self._points_m = update.points_m
        elif update.start == len(self._points_m):
            self._points_m = np.concatenate([self._points_m, update.points_m])
        self._around = _Around(0.0, 0.0, -inf, self._points_m)

    def near(self, x_m: float, y_m: float, reach_m: float) -> Points:
        """The points (N, 2) less than `reach_m` from a place along both axes."""
        around = self._around
        if max(abs(x_m - around.x_m), abs(y_m - around.y_m)) + reach_m > around.reach_m:
            reach_around_m = reach_m + _MARGIN_M
            kept = _within(self._points_m, x_m, y_m, reach_around_m)
            around = self._around = _Around(x_m, y_m, reach_around_m, kept)
        points: Points = _within(around.points_m, x_m, y_m, reach_m).astype(np.float64)
        return points


def _within(points_m: npt.NDArray[np.float32], x_m: float, y_m: float, reach_m: float) -> npt.NDArray[np.float32]:
    x, y = points_m.T
    inside = (np.abs(x - np.float32(x_m)) < reach_m) & (np.abs(y - np.float32(y_m)) < reach_m)
    found: npt.NDArray[np.float32] = points_m[inside]
    return found
