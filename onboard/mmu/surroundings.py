"""Surroundings: what the ranges say about walls, apart from how the sonars are wired.

A sonar hears a wall from its perpendicular foot anywhere in a beam 60 degrees wide, so a single range does not say
where the wall is. A moving sonar knows: for a plane as for a point, the range changes along the way by minus the cosine
of the direction to the echo. A straight-line fit of range over distance travelled gives that direction to about a
degree, and what does not fit (cross-talk, early echoes, a wall's end) gives itself away. (Regions of constant depth:
Leonard and Durrant-Whyte 1992; synthetic aperture in one dimension.)
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import acos, atan2, cos, hypot, radians, sin, sqrt

import numpy as np

from common.constants import SONAR_RANGE_MIN_M, SONAR_STEP_M
from common.geometry import Pose2, wrap_angle

WINDOW_HALF_M = 0.25  # travel before and after a sample that its direction is fitted over
BASELINE_MIN_M = 0.18
SAMPLES_MIN = 5
TURN_MAX_RAD = radians(8.0)  # a window in which the robot turned more says nothing
FIT_SD_MAX_M = 0.03
SIDEWAYS_SD_MAX_M = 0.15  # an echo whose place along the wall is less certain is dropped
HEAD_ON_RAD = radians(20.0)
ROUNDING_SD_M = SONAR_STEP_M / sqrt(12.0)
BEAM_HALF_RAD = radians(38.0)
MISSES_MAX = 3
STANDING_M = 0.002
RAY_EVERY_M = 0.08
RAY_EVERY_RAD = radians(3.0)
SAMPLE_GAP_S = 0.02  # a range that is not this much newer is the same one again


@dataclass(frozen=True, slots=True)
class Sample:
    """One range, with the pose (odom) that it was measured from."""

    t_s: float
    pose: Pose2
    range_m: float
    travel_m: float


@dataclass(frozen=True, slots=True)
class Echo:
    """A place on a wall (odom), and the direction from the robot to it, which is the wall's normal for a plane."""

    t_s: float
    x_m: float
    y_m: float
    direction_rad: float
    range_m: float
    sd_m: float


@dataclass(frozen=True, slots=True)
class Ray:
    """Space that a range showed to be free: from the ring's centre along the beam's axis, `free_m` far (odom)."""

    t_s: float
    pose: Pose2
    bearing_rad: float
    free_m: float


@dataclass(slots=True)
class BeamTrack:
    """The run of ranges of one sonar that belong to one thing."""

    bearing_rad: float
    step_m: float
    samples: list[Sample] = field(default_factory=list)
    pending: Sample | None = None
    misses: int = 0
    placed: int = 0  # samples already turned into echoes

    def miss(self) -> list[Echo]:
        self.misses += 1
        return self.finish() if self.misses >= MISSES_MAX else []

    def add(self, sample: Sample) -> list[Echo]:
        self.misses = 0
        if not self.samples:
            self.samples.append(sample)
            return []
        if self._follows(self.samples[-1], sample):
            self.pending = None
            if abs(sample.travel_m - self.samples[-1].travel_m) < STANDING_M:
                return []
            self.samples.append(sample)
            return self._place(final=False)
        if self.pending is not None and self._follows(self.pending, sample):
            done = self.finish()
            self.samples = [sample]
            return done
        self.pending = sample
        return []

    def finish(self) -> list[Echo]:
        echoes = self._place(final=True)
        self.samples, self.pending, self.placed, self.misses = [], None, 0, 0
        return echoes

    def _follows(self, before: Sample, after: Sample) -> bool:
        """A range changes by no more than the way in between, but for rounding and noise."""
        moved = abs(after.travel_m - before.travel_m)
        return abs(after.range_m - before.range_m) <= moved + 1.5 * self.step_m + 0.01 * before.range_m

    def _place(self, final: bool) -> list[Echo]:
        """Echoes of all samples whose window is complete."""
        echoes: list[Echo] = []
        end_m = self.samples[-1].travel_m if self.samples else 0.0
        while self.placed < len(self.samples):
            sample = self.samples[self.placed]
            if not final and end_m - sample.travel_m < WINDOW_HALF_M:
                break
            echo = self._fit(self.placed)
            if echo is not None:
                echoes.append(echo)
            self.placed += 1
        drop = self.placed
        while drop > 0 and self.samples[drop - 1].travel_m > (end_m - 3 * WINDOW_HALF_M):
            drop -= 1
        if drop > 40:
            del self.samples[:drop]
            self.placed -= drop
        return echoes

    def _fit(self, index: int) -> Echo | None:
        centre = self.samples[index]
        if centre.range_m <= SONAR_RANGE_MIN_M + self.step_m:
            return None
        near = [
            s
            for s in self.samples[max(index - 40, 0) : index + 41]
            if abs(s.travel_m - centre.travel_m) <= WINDOW_HALF_M
            and abs(wrap_angle(s.pose.heading_rad - centre.pose.heading_rad)) <= TURN_MAX_RAD
        ]
        if len(near) < SAMPLES_MIN:
            return None
        dx, dy = near[-1].pose.x_m - near[0].pose.x_m, near[-1].pose.y_m - near[0].pose.y_m
        baseline_m = hypot(dx, dy)
        if baseline_m < BASELINE_MIN_M:
            return None
        ux, uy = dx / baseline_m, dy / baseline_m
        s = np.array([(n.pose.x_m - centre.pose.x_m) * ux + (n.pose.y_m - centre.pose.y_m) * uy for n in near])
        r = np.array([n.range_m for n in near])
        slope, offset, sd_m, slope_sd = _line(s, r)
        if sd_m > FIT_SD_MAX_M:
            return None
        travel_rad = atan2(uy, ux)
        axis_rad = wrap_angle(centre.pose.heading_rad + self.bearing_rad - travel_rad)
        off_rad = acos(min(max(-slope, -1.0), 1.0)) * (1.0 if axis_rad >= 0 else -1.0)
        if offset * slope_sd > SIDEWAYS_SD_MAX_M * max(sin(abs(off_rad)), 1e-6):
            # Head-on the range says nothing of the direction: only a sonar that looks that way itself can tell
            if abs(axis_rad) > HEAD_ON_RAD or -slope < cos(HEAD_ON_RAD):
                return None
            off_rad = axis_rad
        off_axis_rad = wrap_angle(off_rad - axis_rad)
        if abs(off_axis_rad) > BEAM_HALF_RAD:
            return None
        direction_rad = wrap_angle(travel_rad + off_rad)
        return Echo(
            centre.t_s,
            centre.pose.x_m + offset * cos(direction_rad),
            centre.pose.y_m + offset * sin(direction_rad),
            direction_rad,
            offset,
            sd_m / sqrt(len(near)),
        )


def _line(s: np.ndarray, r: np.ndarray) -> tuple[float, float, float, float]:
    """Slope, value at s = 0, residual sd and the slope's sd of the least-squares line through r(s)."""
    ms, mr = float(s.mean()), float(r.mean())
    ds = s - ms
    spread = max(float(ds @ ds), 1e-9)
    slope = float(ds @ r) / spread
    residual = r - mr - slope * ds
    sd = sqrt(float(residual @ residual) / max(len(s) - 2, 1))
    return slope, mr - slope * ms, sd, max(sd, ROUNDING_SD_M) / sqrt(spread)


class Surroundings:
    """Ranges in, echoes and free rays out, for any number and bearing of beams (MMU_SR_05)."""

    def __init__(self, bearings_rad: tuple[float, ...], step_m: float = SONAR_STEP_M) -> None:
        self._bearings_rad = bearings_rad
        self._half_step_m = step_m / 2
        self._tracks = [BeamTrack(b, step_m) for b in bearings_rad]
        self._newest_s = [float("-inf")] * len(bearings_rad)
        self._recent: list[deque[float]] = [deque(maxlen=3) for _ in bearings_rad]
        self._ray_poses: list[Pose2 | None] = [None] * len(bearings_rad)
        self._travel_m = 0.0
        self._last_pose: Pose2 | None = None

    def add(
        self, t_s: float, poses: list[tuple[float, Pose2]], ranges_m: tuple[float, ...], ages_s: tuple[float, ...]
    ) -> tuple[list[Echo], list[Ray]]:
        """One report of all beams; `poses` are recent (time, odom pose), newest last, to measure the ranges from."""
        newest = poses[-1][1]
        if self._last_pose is not None:
            self._travel_m += self._last_pose.distance_m(newest)
        self._last_pose = newest
        echoes: list[Echo] = []
        rays: list[Ray] = []
        for i, (range_m, age_s) in enumerate(zip(ranges_m, ages_s, strict=True)):
            measured_s = t_s - age_s
            if measured_s < self._newest_s[i] + SAMPLE_GAP_S:
                continue
            self._newest_s[i] = measured_s
            pose = pose_at(poses, measured_s)
            track = self._tracks[i]
            heard = range_m == range_m
            self._recent[i].append(range_m if heard else float("inf"))
            if heard:
                behind_m = pose.distance_m(newest)
                sample = Sample(measured_s, pose, range_m + self._half_step_m, self._travel_m - behind_m)
                echoes += track.add(sample)
            else:
                echoes += track.miss()
            if len(self._recent[i]) == 3 and self._ray_due(i, pose):
                rays.append(Ray(measured_s, pose, self._bearings_rad[i], sorted(self._recent[i])[1]))
        return echoes, rays

    def _ray_due(self, beam: int, pose: Pose2) -> bool:
        """From where the last ray came there is nothing new to see."""
        last = self._ray_poses[beam]
        turned_rad = abs(wrap_angle(pose.heading_rad - last.heading_rad)) if last is not None else RAY_EVERY_RAD
        if last is not None and last.distance_m(pose) < RAY_EVERY_M and turned_rad < RAY_EVERY_RAD:
            return False
        self._ray_poses[beam] = pose
        return True


def pose_at(poses: list[tuple[float, Pose2]], t_s: float) -> Pose2:
    """The pose at a time, interpolated between recorded ones; the nearest end outside of them."""
    if t_s >= poses[-1][0]:
        return poses[-1][1]
    for (ta, a), (tb, b) in zip(reversed(poses[:-1]), reversed(poses[1:]), strict=True):
        if t_s >= ta:
            f = (t_s - ta) / max(tb - ta, 1e-9)
            turn = wrap_angle(b.heading_rad - a.heading_rad)
            return Pose2(a.x_m + f * (b.x_m - a.x_m), a.y_m + f * (b.y_m - a.y_m), wrap_angle(a.heading_rad + f * turn))
    return poses[0][1]
