"""How well the robot is received: its poses -> share that arrived, longest silence. Pure.

Poses come at a known rate, so those that are missing can be counted by the robot's own times, at any pace of a
simulated clock.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

from common.constants import POSE_RATE_HZ

WINDOW = 100  # poses: ten seconds
_PERIOD_S = 1.0 / POSE_RATE_HZ


class LinkQuality:
    """`add` every pose."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, float]] = deque(maxlen=WINDOW)  # when measured, when arrived

    def add(self, t_s: float, arrived_s: float) -> None:
        if self._poses and t_s < self._poses[-1][0]:
            self._poses.clear()  # a robot that was restarted
        self._poses.append((t_s, arrived_s))

    @property
    def share(self) -> float | None:
        """Of the newest WINDOW poses so many arrived; None before there are two."""
        if len(self._poses) < 2:
            return None
        expected = (self._poses[-1][0] - self._poses[0][0]) / _PERIOD_S
        return min(1.0, (len(self._poses) - 1) / expected) if expected > 0.0 else 1.0

    @property
    def longest_gap_s(self) -> float | None:
        """Between two of them, by arrival; None before there are two."""
        return max((b[1] - a[1] for a, b in pairwise(self._poses)), default=None)
