"""The robot's clock -> wall time, which ROS stamps with: by the message that took the shortest way. Pure."""

from __future__ import annotations

from math import inf

from offboard.export.run_time import NEWEST_S, NS

JUMP_S = 1.0  # a message that seems so much later than the others comes from a clock that has begun anew
DRIFT = 1e-3  # two clocks part by less; so much later a message may be each second


class WallTime:
    """`take` the stamp of every message as it arrives; `of` gives any other stamp of that clock (nanoseconds)."""

    def __init__(self) -> None:
        self._ahead_s = inf  # by which wall time is ahead of the robot's clock, the shortest delay included
        self._taken_s = 0.0

    def take(self, t_s: float, wall_s: float) -> None:
        allowed_s = self._ahead_s + DRIFT * max(0.0, wall_s - self._taken_s)
        self._taken_s, ahead_s = wall_s, wall_s - t_s
        self._ahead_s = ahead_s if ahead_s - allowed_s > JUMP_S else min(ahead_s, allowed_s)

    def of(self, t_s: float) -> int:
        return round(min(max(0.0, self._ahead_s + t_s), NEWEST_S) * NS)
