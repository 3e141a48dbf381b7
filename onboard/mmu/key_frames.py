"""Key frames and what was seen from them: values that the front end hands to the back end, and arrays of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.geometry import FloatArray, Points, Pose2


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """A pose in `odom`, and the way there: how far, turned by how much (left positive), seconds spent driving."""

    t_s: float
    odom: Pose2
    travel_m: float
    way_m: float  # travel and turning together: how much new was seen
    turned_rad: float  # sum of the turns since the start, by raw odometry
    calibrated_rad: float  # of which that much was added by the calibration then in force
    certain: bool = True  # false: the robot may have been carried since the key frame before


@dataclass(frozen=True, slots=True)
class LastSeen:
    """Where the robot was last: in the map, and by the board's own dead reckoning of that session."""

    session: int
    board: Pose2
    pose: Pose2


@dataclass(slots=True)
class FrameStore:
    """Directed lengths (echoes, free rays), each in the frame of its key frame; grows by doubling.

    Columns: key frame, way (m), x (m), y (m), direction (rad; an echo's is the wall's normal), length (m).
    """

    count: int = 0
    _rows: FloatArray = field(default_factory=lambda: np.zeros((1024, 6)))

    def append(self, rows: FloatArray) -> None:
        """(N, 6) more."""
        while self.count + len(rows) > len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self.count : self.count + len(rows)] = rows
        self.count += len(rows)

    def rows(self, start: int = 0) -> FloatArray:
        """(N, 6) from the `start`-th on."""
        return self._rows[start : self.count]

    def stretch(self, from_m: float, to_m: float = float("inf")) -> FloatArray:
        """(N, 6) of a stretch of the way."""
        rows = self._rows[: self.count]
        return rows[(rows[:, 1] >= from_m) & (rows[:, 1] <= to_m)]


def in_map(rows: FloatArray, poses: FloatArray) -> tuple[Points, FloatArray]:
    """Points (N, 2) and directions (N,) in the map of such rows, given all key frame poses (K, 3)."""
    p = poses[rows[:, 0].astype(int)]
    c, s = np.cos(p[:, 2]), np.sin(p[:, 2])
    x, y = rows[:, 2], rows[:, 3]
    return np.stack([p[:, 0] + c * x - s * y, p[:, 1] + s * x + c * y], axis=1), rows[:, 4] + p[:, 2]
