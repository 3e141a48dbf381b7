"""The path that the robot has driven, as a bounded number of poses. Pure."""

from __future__ import annotations

from collections import deque
from math import hypot, inf

import numpy as np

from common.geometry import FloatArray
from common.messages.mapping import PoseEstimate, Trajectory

STEP_M = 0.1
SINCE_MAX = 5_000  # poses since the smoothed path ends, which comes every few seconds
POSES_MAX = 1_000  # of a message: each costs 20 us


class DrivenPath:
    """Smoothed as far as that reaches, then as it was driven."""

    def __init__(self) -> None:
        self._smoothed: FloatArray = np.empty((0, 4))  # t, x, y, heading
        self._since: deque[tuple[float, float, float, float]] = deque(maxlen=SINCE_MAX)

    def take_trajectory(self, trajectory: Trajectory) -> None:
        self._smoothed = np.column_stack([trajectory.times_s, trajectory.poses]).astype(np.float64)
        end_s = float(self._smoothed[-1, 0]) if len(self._smoothed) else -inf
        self._since = deque((pose for pose in self._since if pose[0] > end_s), SINCE_MAX)

    def take_pose(self, pose: PoseEstimate) -> bool:
        """True where it lies further on than the one before."""
        last = self._since[-1] if self._since else self._smoothed[-1] if len(self._smoothed) else None
        if not pose.valid or (last is not None and hypot(pose.x_m - last[1], pose.y_m - last[2]) < STEP_M):
            return False
        self._since.append((pose.t_s, pose.x_m, pose.y_m, pose.heading_rad))
        return True

    def poses(self) -> FloatArray:
        """(K, 4) t, x, y, heading: evenly chosen ones of all, with the newest, where they are more than POSES_MAX."""
        every = np.concatenate([self._smoothed, np.array(self._since).reshape(-1, 4)])
        stride = max(1, -(-len(every) // POSES_MAX))
        return every[::-1][::stride][::-1]
