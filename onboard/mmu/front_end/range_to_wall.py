"""Range to a wall straight ahead: by how much it comes nearer, against what the wheels drove.

Samples of one beam that looks ahead, on a straight piece of path -> `RangeToWall`. It shows how far the wheels really
drove: walls beside the path and places visited before fit as well into a map that is too large. A range that is
off by the same amount everywhere (a step, the ring's radius) cancels; one that is off by a share (speed of sound) does
not, and makes the whole map that much larger.

1. Along the heading of the first sample, place + range is the wall's foot: alike for all samples of one wall.
2. What departs from the newest feet is skipped; several in a row, or a turn, end the run.
3. The medians over both ends of the run are compared; the one at the middle must lie between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin
from statistics import median

import numpy as np

from common.geometry import FloatArray, Pose2, wrap_angle

AHEAD_RAD = radians(10.0)  # a beam that looks further aside meets no wall ahead squarely
# Of the run. The sensitivity was not measured
PATH_MIN_M = 1.5
END_M = 0.5  # of each end
SAMPLES_MIN = 4  # at each end
TURN_MAX_RAD = radians(8.0)
DEPARTS_M = 0.06
DEPARTS_SHARE = 0.01  # of the range
RECENT = 5
OUTLIERS_MAX = 4
OBLIQUE_M = 0.03  # a wall not square to the path comes nearer by less than the path
OBLIQUE_SHARE = 0.04
KINK_M = 0.03  # at the middle the foot lies where both ends put it, or these were not one wall


@dataclass(frozen=True, slots=True)
class RangeToWall:
    """From `far` to `near` (odom) the wall ahead came nearer by `closer_m`, along its normal; `left_m` were left."""

    far_t_s: float
    far: Pose2
    near_t_s: float
    near: Pose2
    closer_m: float
    left_m: float


@dataclass(slots=True)
class WallAheadTrack:
    """The run of ranges of one beam that belong to one wall ahead."""

    bearing_rad: float
    _samples: list[tuple[float, Pose2, float]] = field(default_factory=list)  # time, pose (odom), range
    _feet_m: list[float] = field(default_factory=list)
    _outliers: int = 0

    def add(self, t_s: float, pose: Pose2, range_m: float) -> RangeToWall | None:
        """One range; what the run before measured, if this range ends it."""
        done = None
        if self._samples and not self._continues(pose, range_m):
            if not self._turned(pose) and self._outliers < OUTLIERS_MAX:
                self._outliers += 1
                return None
            done = self.finish()
        self._outliers = 0
        self._feet_m.append(self._foot_m(self._samples[0][1] if self._samples else pose, pose, range_m))
        self._samples.append((t_s, pose, range_m))
        return done

    def finish(self) -> RangeToWall | None:
        """The run is over."""
        samples, feet_m = self._samples, np.array(self._feet_m)
        self._samples, self._feet_m, self._outliers = [], [], 0
        if len(samples) < 2 * SAMPLES_MIN:
            return None
        path_m = feet_m - np.array([range_m for _, _, range_m in samples])  # along the first heading
        if abs(path_m[-1] - path_m[0]) < PATH_MIN_M:
            return None
        at_far, at_near = np.abs(path_m - path_m[0]) <= END_M, np.abs(path_m - path_m[-1]) <= END_M
        if at_far.sum() < SAMPLES_MIN or at_near.sum() < SAMPLES_MIN:
            return None
        far, near = _middle(at_far), _middle(at_near)
        passed_m = float(np.median(feet_m[at_near]) - np.median(feet_m[at_far]))
        driven_m = float(path_m[near] - path_m[far])
        middle = np.abs(path_m - (path_m[0] + path_m[-1]) / 2) <= END_M / 2
        ends_m = (float(np.median(feet_m[at_near])) + float(np.median(feet_m[at_far]))) / 2
        if abs(passed_m) > OBLIQUE_M + OBLIQUE_SHARE * abs(driven_m) or middle.sum() < SAMPLES_MIN:
            return None
        if abs(float(np.median(feet_m[middle])) - ends_m) > KINK_M:
            return None
        left_m = float(np.median(feet_m[at_near]) - path_m[near])
        (far_t_s, far_pose, _), (near_t_s, near_pose, _) = samples[far], samples[near]
        return RangeToWall(far_t_s, far_pose, near_t_s, near_pose, driven_m - passed_m, left_m)

    def _continues(self, pose: Pose2, range_m: float) -> bool:
        if self._turned(pose):
            return False
        off_m = self._foot_m(self._samples[0][1], pose, range_m) - median(self._feet_m[-RECENT:])
        return abs(off_m) <= DEPARTS_M + DEPARTS_SHARE * range_m

    def _turned(self, pose: Pose2) -> bool:
        return bool(self._samples) and abs(wrap_angle(pose.heading_rad - self._axis_rad)) > TURN_MAX_RAD

    @property
    def _axis_rad(self) -> float:
        return self._samples[0][1].heading_rad

    def _foot_m(self, first: Pose2, pose: Pose2, range_m: float) -> float:
        axis_rad = first.heading_rad + self.bearing_rad
        return (pose.x_m - first.x_m) * cos(axis_rad) + (pose.y_m - first.y_m) * sin(axis_rad) + range_m


def _middle(chosen: FloatArray) -> int:
    """Index of the middle one of those chosen."""
    indices = np.flatnonzero(chosen)
    return int(indices[len(indices) // 2])
