"""Where the robot drove, in the map as it was then."""

from __future__ import annotations

from array import array
from math import hypot

import numpy as np

from common.geometry import Points, Pose2

SPACING_M = 0.1


class Trail:
    """`points` grow by one every SPACING_M."""

    def __init__(self) -> None:
        self._xy = array("f")

    def drive(self, pose: Pose2) -> None:
        """The robot is here now."""
        if len(self._xy) and hypot(self._xy[-2] - pose.x_m, self._xy[-1] - pose.y_m) < SPACING_M:
            return
        self._xy.extend((pose.x_m, pose.y_m))

    @property
    def points(self) -> Points:
        """All of them (N, 2)."""
        points: Points = np.array(self._xy, dtype=np.float64).reshape(-1, 2)
        return points
