"""A wall straight ahead comes nearer: by how much, according to the sonar, against what the wheels drove.

Samples of one beam that looks ahead, on a straight piece of way -> `Approach`. It is what gives away how far the wheels
really drove: walls beside the way, and places visited before, are met alike by a map that is too large. A range that is
off by the same amount everywhere (a step, the ring's radius) cancels; one that is off by a share (speed of sound) does
not, and makes the whole map that much larger.

1. Along the heading of the first sample, place + range is the wall's foot: alike for all samples of one wall.
2. What departs from the newest feet is passed over; several in a row, or a turn, end the run.
3. The medians over both ends of the run are compared; one half way must lie between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin

import numpy as np

from common.geometry import FloatArray, Pose2, wrap_angle

AHEAD_RAD = radians(10.0)  # a beam that looks further aside sees no wall ahead squarely
WAY_MIN_M = 1.5
END_M = 0.5  # of each end
SAMPLES_MIN = 4  # at each end
TURN_MAX_RAD = radians(8.0)
DEPARTS_M = 0.06
DEPARTS_SHARE = 0.01  # of the range
RECENT = 5
STRAYS_MAX = 4
OBLIQUE_M = 0.03  # a wall not square to the way comes nearer by less than the way
OBLIQUE_SHARE = 0.04
KINK_M = 0.03  # half way the foot lies where both ends say, or these were not one wall


@dataclass(frozen=True, slots=True)
class Approach:
    """From `far` to `near` (odom) the wall ahead came nearer by `closer_m`, along its normal; `left_m` were left."""

    far_t_s: float
    far: Pose2
    near_t_s: float
    near: Pose2
    closer_m: float
    left_m: float


@dataclass(slots=True)
class ApproachTrack:
    """The run of ranges of one beam that belong to one wall ahead."""

    bearing_rad: float
    _samples: list[tuple[float, Pose2, float]] = field(default_factory=list)  # time, pose (odom), range
    _feet_m: list[float] = field(default_factory=list)
    _strays: int = 0

    def add(self, t_s: float, pose: Pose2, range_m: float) -> Approach | None:
        """One range; the approach that it shows to be over, if any."""
        done = None
        if self._samples and not self._goes_on(pose, range_m):
            if not self._turned(pose) and self._strays < STRAYS_MAX:
                self._strays += 1
                return None
            done = self.finish()
        self._strays = 0
        self._feet_m.append(self._foot_m(self._samples[0][1] if self._samples else pose, pose, range_m))
        self._samples.append((t_s, pose, range_m))
        return done

    def finish(self) -> Approach | None:
        """The run is over."""
        samples, feet_m = self._samples, np.array(self._feet_m)
        self._samples, self._feet_m, self._strays = [], [], 0
        if len(samples) < 2 * SAMPLES_MIN:
            return None
        way_m = feet_m - np.array([range_m for _, _, range_m in samples])  # along the first heading
        if abs(way_m[-1] - way_m[0]) < WAY_MIN_M:
            return None
        at_far, at_near = np.abs(way_m - way_m[0]) <= END_M, np.abs(way_m - way_m[-1]) <= END_M
        if at_far.sum() < SAMPLES_MIN or at_near.sum() < SAMPLES_MIN:
            return None
        far, near = _middle(at_far), _middle(at_near)
        passed_m = float(np.median(feet_m[at_near]) - np.median(feet_m[at_far]))
        driven_m = float(way_m[near] - way_m[far])
        half_way = np.abs(way_m - (way_m[0] + way_m[-1]) / 2) <= END_M / 2
        ends_m = (float(np.median(feet_m[at_near])) + float(np.median(feet_m[at_far]))) / 2
        if abs(passed_m) > OBLIQUE_M + OBLIQUE_SHARE * abs(driven_m) or half_way.sum() < SAMPLES_MIN:
            return None
        if abs(float(np.median(feet_m[half_way])) - ends_m) > KINK_M:
            return None
        left_m = float(np.median(feet_m[at_near]) - way_m[near])
        (far_t_s, far_pose, _), (near_t_s, near_pose, _) = samples[far], samples[near]
        return Approach(far_t_s, far_pose, near_t_s, near_pose, driven_m - passed_m, left_m)

    def _goes_on(self, pose: Pose2, range_m: float) -> bool:
        if self._turned(pose):
            return False
        off_m = self._foot_m(self._samples[0][1], pose, range_m) - float(np.median(self._feet_m[-RECENT:]))
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
