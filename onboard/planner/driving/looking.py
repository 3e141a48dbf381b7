"""Standing at a heading until ranges and grid are up to date: pose and time in, whether that is complete out."""

from __future__ import annotations

from math import inf, radians

from common.geometry import Pose2, wrap_angle

LOOK_S = 1.2  # standing after a turn
HEADING_REACHED_RAD = radians(3.0)
TURN_TIMEOUT_S = 12.0


class Looking:
    """The present look, towards `heading_rad`."""

    def __init__(self) -> None:
        self.heading_rad = 0.0
        self._next_rad: float | None = None
        self._since_s = 0.0
        self._settled_s = inf

    def begin(self, heading_rad: float, now_s: float, then_rad: float | None = None) -> None:
        """Look there, and after that towards `then_rad`."""
        self.heading_rad, self._next_rad = heading_rad, then_rad
        self._since_s, self._settled_s = now_s, inf

    def over(self, pose: Pose2, now_s: float) -> bool:
        """Is the look complete, or its time for turning over?"""
        if self._settled_s == inf and abs(wrap_angle(self.heading_rad - pose.heading_rad)) < HEADING_REACHED_RAD:
            self._settled_s = now_s
        if now_s - self._since_s <= TURN_TIMEOUT_S and now_s - self._settled_s <= LOOK_S:
            return False
        if self._next_rad is None:
            return True
        self.begin(self._next_rad, now_s)
        return False
