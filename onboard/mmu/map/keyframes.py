"""Keyframes, their poses in the map, and what was observed from them: a submap each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points, Pose2
from onboard.mmu.map.growing_rows import GrowingRows


@dataclass(frozen=True, slots=True)
class StatedPose:
    """Where the robot stands as a person says, as seen from a keyframe beside it, with its standard deviations."""

    anchor: int
    pose: Pose2
    sd_m: float
    sd_rad: float


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A pose in `odom`, and the path there: how far, turned by how much (left positive)."""

    t_s: float
    odom: Pose2
    travel_m: float
    path_m: float  # travel and turning together: how much new was in view
    turned_rad: float  # sum of the turns since the start, by raw odometry
    calibrated_rad: float  # of which that much was added by the calibration then in force
    certain: bool = True  # false: the robot may have been kidnapped since the keyframe before
    slip_m_per_sqrt_m: float | None = None  # of the path, where it is known
    stated: StatedPose | None = None  # a person said where the robot stands


@dataclass(frozen=True, slots=True)
class LastSeen:
    """Where the robot was last: in the map, and by the board's own dead reckoning of that session."""

    session: int
    board: Pose2
    pose: Pose2


class ObservationStore:
    """Directed lengths (echoes, free rays), each relative to its keyframe.

    Columns: keyframe, path (m), x (m), y (m), direction (rad; an echo's is the wall's normal), length (m). Kept in
    single precision, which is a tenth of a millimetre after a kilometre; what comes out is double.
    """

    def __init__(self) -> None:
        self._kept = GrowingRows(np.float32, (6,), 1024)

    def __len__(self) -> int:
        return len(self._kept)

    def append(self, rows: npt.ArrayLike) -> None:
        """(N, 6) more."""
        self._kept.append(rows)

    def rows(self, start: int = 0, end: int | None = None) -> FloatArray:
        """(N, 6) from the `start`-th on, up to the `end`-th."""
        return self._kept.rows[start:end].astype(np.float64)

    def stretch(self, from_m: float, to_m: float = float("inf")) -> FloatArray:
        """(N, 6) of a stretch of the path."""
        rows = self._kept.rows
        return rows[(rows[:, 1] >= from_m) & (rows[:, 1] <= to_m)].astype(np.float64)

    def newest(self, path_m: float, least_m: float, most_m: float, enough: int) -> FloatArray:
        """(N, 6) of the newest stretch that ends at `path_m`: as long as holds `enough`, within these lengths."""
        rows = self.stretch(path_m - most_m)
        back_m = np.sort(path_m - rows[:, 1])
        long_m = float(np.clip(back_m[enough - 1] if len(back_m) >= enough else most_m, least_m, most_m))
        return rows[rows[:, 1] >= path_m - long_m]


class PoseStore:
    """Poses of all keyframes in the map."""

    def __init__(self) -> None:
        self._kept = GrowingRows(shape=(3,))

    @property
    def array(self) -> FloatArray:
        """(K, 3)."""
        return self._kept.rows

    @property
    def last(self) -> Pose2:
        return Pose2.from_array(self.array[-1])

    def append(self, pose: Pose2) -> None:
        self._kept.append([pose.as_array()])

    def correct(self, poses: FloatArray) -> None:
        """The first of them lie at `poses` (N, 3); those that are newer follow the last of these."""
        known = len(poses)
        newer: list[Pose2] = []
        if len(self._kept) > known > 0:
            shift = Pose2.from_array(poses[-1]).compose(Pose2.from_array(self.array[known - 1]).inverse())
            newer = [shift.compose(Pose2.from_array(p)) for p in self.array[known:]]
        self._kept.replace(poses)
        for pose in newer:
            self.append(pose)


def in_map(rows: FloatArray, poses: FloatArray) -> tuple[Points, FloatArray]:
    """Points (N, 2) and directions (N,) in the map of such rows, given the poses (K, 3) of all keyframes."""
    p = poses[rows[:, 0].astype(int)]
    c, s = np.cos(p[:, 2]), np.sin(p[:, 2])
    x, y = rows[:, 2], rows[:, 3]
    points = np.empty((len(rows), 2))
    points[:, 0], points[:, 1] = p[:, 0] + c * x - s * y, p[:, 1] + s * x + c * y
    return points, rows[:, 4] + p[:, 2]
