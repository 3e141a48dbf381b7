"""The robot's pose when a frame was taken: POSE messages in, the pose at any recent time out.

The mapping unit stamps with the clock of its own board. A message cannot arrive before it was sent, so the smallest
difference between arrival and stamp estimates the offset of the two clocks.
"""

from __future__ import annotations

import bisect
from math import hypot, inf

from common.geometry import FloatArray, Pose2, wrap_angle
from common.messages.mapping import PoseEstimate

KEPT = 600  # poses, one minute
EXTRAPOLATED_MAX_S = 0.25  # 4 cm at mapping speed
_RATE_SPAN_S = 0.35  # over which the motion is measured


class PoseHistory:
    """The newest poses, oldest first, on the clock of whoever calls."""

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._poses: list[Pose2] = []
        self._offset_s = inf

    def add(self, estimate: PoseEstimate, now_s: float) -> None:
        """Takes a pose that arrived at `now_s`."""
        self._offset_s = min(self._offset_s, now_s - estimate.t_s)
        if self._times_s and estimate.t_s <= self._times_s[-1]:
            return
        self._times_s.append(estimate.t_s)
        self._poses.append(estimate.pose)
        if len(self._times_s) > KEPT:
            del self._times_s[0], self._poses[0]

    def stamp_s(self, t_s: float) -> float:
        """A time of this board on the clock of the mapping unit."""
        return t_s - self._offset_s

    def here_s(self, stamps_s: FloatArray) -> FloatArray:
        """Times of the mapping unit's clock on that of this board; none before its first pose."""
        return stamps_s + self._offset_s

    @property
    def newest(self) -> Pose2 | None:
        return self._poses[-1] if self._poses else None

    def covers(self, t_s: float) -> bool:
        """Whether a pose of that time of this board, or of a later one, has arrived."""
        return bool(self._times_s) and self.stamp_s(t_s) <= self._times_s[-1]

    def at(self, t_s: float) -> Pose2 | None:
        """The pose at a time of this board, extrapolated for EXTRAPOLATED_MAX_S at most; None where none is known."""
        return self.at_stamp(self.stamp_s(t_s))

    def at_stamp(self, stamp_s: float) -> Pose2 | None:
        """The pose at a time of the mapping unit's clock."""
        times_s = self._times_s
        if len(times_s) < 2 or stamp_s < times_s[0] or stamp_s > times_s[-1] + EXTRAPOLATED_MAX_S:
            return None
        i = min(max(bisect.bisect_left(times_s, stamp_s), 1), len(times_s) - 1)
        a, b = self._poses[i - 1], self._poses[i]
        share = (stamp_s - times_s[i - 1]) / (times_s[i] - times_s[i - 1])
        return Pose2(
            a.x_m + share * (b.x_m - a.x_m),
            a.y_m + share * (b.y_m - a.y_m),
            wrap_angle(a.heading_rad + share * wrap_angle(b.heading_rad - a.heading_rad)),
        )

    def motion(self) -> tuple[float, float]:
        """Speed (m/s) and turning rate (rad/s), unsigned, over the newest third of a second; infinite when unknown."""
        times_s = self._times_s
        if len(times_s) < 2:
            return inf, inf
        i = max(bisect.bisect_left(times_s, times_s[-1] - _RATE_SPAN_S), 0)
        i = min(i, len(times_s) - 2)
        a, b, span_s = self._poses[i], self._poses[-1], times_s[-1] - times_s[i]
        return (
            hypot(b.x_m - a.x_m, b.y_m - a.y_m) / span_s,
            abs(wrap_angle(b.heading_rad - a.heading_rad)) / span_s,
        )
