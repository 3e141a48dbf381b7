"""How often and how long something has been in the way: obstacles around one place, and a place without a path to it.

Pure; time is given in seconds, places are in metres on the map.
"""

from __future__ import annotations

from math import hypot

from common.geometry import Pose2
from onboard.planner.exploration.recovery_memory import STAGNANT_M

OBSTRUCTIONS_MAX = 2  # next to where it wants to get, then that is given up
OBSTRUCTION_NEAR_M = 1.5
MET_MAX = 4  # obstacles in a row at one place on the way home: there is no path, whatever the grid shows
NO_PATH_PATIENCE_S = 300.0  # a door that was closed, a person who stands in a hall: they may go
OBSTACLES_PATIENCE_S = 30.0  # then what was met before may have gone, or was an echo from a corner
RETRY_S = 3.0
PROGRESS_M = 2.0  # so far away it is another place that it waits at


class ObstaclesMet:
    """Obstacles that the map does not know."""

    def __init__(self) -> None:
        self._at, self._in_a_row = Pose2(0.0, 0.0, 0.0), 0  # without getting on
        self._at_target = 0  # since the last arrival

    def meet(self, pose: Pose2) -> bool:
        """One more; whether there have been too many from about here for a path to be believed."""
        if self._at.distance_m(pose) > STAGNANT_M:
            self._at, self._in_a_row = pose, 0
        self._in_a_row += 1
        return self._in_a_row >= MET_MAX

    def block_target(self, target_m: tuple[float, float], obstacle_m: tuple[float, float]) -> bool:
        """Whether the place to drive to is to be given up for it: True once, then the count begins anew."""
        if hypot(target_m[0] - obstacle_m[0], target_m[1] - obstacle_m[1]) >= OBSTRUCTION_NEAR_M:
            return False
        self._at_target = (self._at_target + 1) % OBSTRUCTIONS_MAX
        return self._at_target == 0

    def arrive(self) -> None:
        self._at_target = 0


class PathPatience:
    """Counted from where the wait began: a path that leads nowhere does not renew it."""

    def __init__(self) -> None:
        self._since: tuple[float, Pose2] | None = None
        self._retry_s = 0.0

    def renew(self) -> None:
        self._since = None

    def retries(self, now_s: float) -> bool:
        """Is it time to look for a path again?"""
        return now_s >= self._retry_s

    def wait_s(self, pose: Pose2, now_s: float) -> float:
        """How long there has been no path from about here; to be called whenever there is none."""
        self._retry_s = now_s + RETRY_S
        if self._since is None or self._since[1].distance_m(pose) > PROGRESS_M:
            self._since = now_s, pose
        return now_s - self._since[0]
