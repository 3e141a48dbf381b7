"""How the map moved when the mapping unit corrected its past: trajectories in, what was observed then moves along.

A place on a wall is known relative to the robot that saw it. So it moves with the keyframe before its time, as echoes
do in the mapping unit's own map.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray
from common.messages.mapping import Trajectory
from onboard.poi.placement.pose_history import PoseHistory


class MapShift:
    """One correction: the map of before to the map of now."""

    def __init__(self, times_s: FloatArray, before: FloatArray, now: FloatArray) -> None:
        """Of keyframes in their order: times (K,) on the clock of whoever calls, poses (K, 3)."""
        # An earlier session of the board, whose map was continued, may have counted higher
        self._times_s = np.minimum.accumulate(times_s[::-1])[::-1]
        self._turns_rad = now[:, 2] - before[:, 2]
        self._origins = now[:, :2] - _turned(before[:, :2], self._turns_rad)

    def moved(self, places: FloatArray, seen_s: npt.ArrayLike) -> FloatArray:
        """Places (N, 3), x, y and direction on the map of before, that were seen at times (N,): on the map of now.

        What was seen before all keyframes stays.
        """
        keyframes = np.searchsorted(self._times_s, seen_s, side="right") - 1
        known = keyframes >= 0
        of = keyframes[known]
        result = np.array(places, dtype=np.float64)
        result[known, :2] = self._origins[of] + _turned(result[known, :2], self._turns_rad[of])
        result[known, 2] += self._turns_rad[of]
        return result


class BelievedPath:
    """The keyframes as they lay when they were heard of last."""

    def __init__(self) -> None:
        self._times_s, self._poses = np.zeros(0), np.zeros((0, 3))

    def update(self, trajectory: Trajectory, history: PoseHistory) -> MapShift:
        """`history`: where newer keyframes lay when the robot was there; where none is known, they count as unmoved."""
        times_s, now = np.asarray(trajectory.times_s, np.float64), np.asarray(trajectory.poses, np.float64)
        known = len(self._times_s)
        if not np.array_equal(times_s[:known], self._times_s):
            known = 0  # another map
        before = now.copy()
        before[:known] = self._poses[:known]
        for i in range(known, len(now)):
            pose = history.at_stamp(float(times_s[i]))
            if pose is not None:
                before[i] = pose.as_array()
        self._times_s, self._poses = times_s, now
        return MapShift(history.here_s(times_s), before, now)


def _turned(points: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Points (N, 2), each by its angle (N,)."""
    c, s = np.cos(angles_rad), np.sin(angles_rad)
    return np.column_stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]])
