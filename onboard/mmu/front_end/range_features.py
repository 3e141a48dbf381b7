"""Surroundings: what the ranges say about walls, apart from how the sonars are wired.

A sonar hears a wall anywhere in its beam, so a single range does not say where the wall is. The run of ranges of one
sonar that belong to one thing, heard from a moving robot, does (`echo_direction`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import cos, isfinite, pi, radians, sin

import numpy as np

from common.constants import SONAR_RANGE_MIN_M, SONAR_STEP_M
from common.geometry import FloatArray, Pose2, wrap_angle
from onboard.mmu.front_end.echo_direction import Beam, locate
from onboard.mmu.front_end.range_to_wall import AHEAD_RAD, Approach, ApproachTrack

WINDOW_HALF_M = 0.25  # travel before and after a sample that its direction is fitted over
WINDOW_HALF_RAD = radians(35.0)
WINDOW_SAMPLES = 2.2  # to each side, at least: a slow sonar on a fast robot needs a longer window
WINDOW_HALF_MAX_M = 0.6  # where nobody says that ranges lie further apart
BASELINE_MIN_M = 0.18
BASELINE_MIN_RAD = radians(12.0)
SAMPLES_MIN = 4
ECHO_EVERY_M = 0.05  # two on a cell of the grid; denser echoes of one sonar say nothing new
ECHO_EVERY_RAD = radians(6.0)
SIDEWAYS_SD_MAX_M = 0.15  # an echo whose place along the wall is less certain is dropped
NORMAL_SD_MAX_RAD = radians(8.0)
HEAD_ON_RAD = radians(20.0)
BEAM_HALF_RAD = radians(38.0)
MISSES_MAX = 3
STANDING_M = 0.002
STANDING_RAD = radians(1.0)
RAY_EVERY_M = 0.08
RAY_EVERY_RAD = radians(3.0)
SAMPLE_GAP_S = 0.02  # a range that is not this much newer is the same one again
SAMPLES_KEPT = 160


@dataclass(frozen=True, slots=True)
class Sample:
    """One range, with the pose (odom) that it was measured from."""

    t_s: float
    pose: Pose2
    range_m: float
    travel_m: float


@dataclass(frozen=True, slots=True)
class Echo:
    """A place on a wall (odom) and the wall's normal there, away from the robot."""

    t_s: float
    x_m: float
    y_m: float
    normal_rad: float
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
    beam: Beam
    window_half_max_m: float = WINDOW_HALF_MAX_M
    samples: list[Sample] = field(default_factory=list)
    pending: Sample | None = None
    misses: int = 0
    placed: int = 0  # samples already turned into echoes, or passed over
    normals: FloatArray = field(init=False)
    last_placed: Sample | None = None

    def __post_init__(self) -> None:
        self.normals = self.beam.normals()

    def miss(self) -> list[Echo]:
        self.misses += 1
        return self.finish() if self.misses >= MISSES_MAX else []

    def add(self, sample: Sample) -> list[Echo]:
        self.misses = 0
        if not self.samples:
            self.samples.append(sample)
            return []
        last = self.samples[-1]
        if self._follows(last, sample):
            self.pending = None
            if abs(sample.travel_m - last.travel_m) < STANDING_M and _turn(last, sample) < STANDING_RAD:
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
        if self.beam.narrow:
            moved = 1.7 * moved + before.range_m * _turn(before, after)
        return abs(after.range_m - before.range_m) <= moved + 1.5 * self.beam.step_m + 0.01 * before.range_m

    def _place(self, final: bool) -> list[Echo]:
        """Echoes of all samples whose window is complete."""
        echoes: list[Echo] = []
        if not self.samples:
            return echoes
        newest = self.samples[-1]
        half_m = self._window_half_m()
        while self.placed < len(self.samples):
            sample = self.samples[self.placed]
            if not (final or newest.travel_m - sample.travel_m >= half_m or _turn(sample, newest) >= WINDOW_HALF_RAD):
                break
            if self._due(sample):
                echo = self._fit(self.placed, half_m)
                if echo is not None:
                    echoes.append(echo)
                    self.last_placed = sample
            self.placed += 1
        if len(self.samples) > SAMPLES_KEPT:
            drop = min(self.placed, SAMPLES_KEPT // 2)
            del self.samples[:drop]
            self.placed -= drop
        return echoes

    def _window_half_m(self) -> float:
        recent = self.samples[-8:]
        spacing_m = (recent[-1].travel_m - recent[0].travel_m) / max(len(recent) - 1, 1)
        return min(max(WINDOW_HALF_M, WINDOW_SAMPLES * spacing_m), self.window_half_max_m)

    def _due(self, sample: Sample) -> bool:
        last = self.last_placed
        return (
            last is None
            or abs(sample.travel_m - last.travel_m) >= ECHO_EVERY_M
            or _turn(last, sample) >= ECHO_EVERY_RAD
        )

    def _fit(self, index: int, half_m: float) -> Echo | None:
        centre = self.samples[index]
        if centre.range_m <= SONAR_RANGE_MIN_M + self.beam.step_m:
            return None
        first, last = index, index
        while first > 0 and self._near(centre, self.samples[first - 1], half_m):
            first -= 1
        while last < len(self.samples) - 1 and self._near(centre, self.samples[last + 1], half_m):
            last += 1
        near = self.samples[first : last + 1]
        if len(near) < SAMPLES_MIN:
            return None
        way_m = near[-1].travel_m - near[0].travel_m
        if way_m < BASELINE_MIN_M and _turn(near[0], near[-1]) < BASELINE_MIN_RAD:
            return None
        axis_rad = centre.pose.heading_rad + self.bearing_rad
        c, s = cos(axis_rad), sin(axis_rad)
        place = np.array([(n.pose.x_m - centre.pose.x_m, n.pose.y_m - centre.pose.y_m) for n in near])
        at = place @ np.array([[c, -s], [s, c]])
        turned = np.array([wrap_angle(n.pose.heading_rad - centre.pose.heading_rad) for n in near])
        heard = locate(self.beam, self.normals, at, turned, np.array([n.range_m for n in near]), index - first)
        if heard is None:
            return None
        sideways_sd_m = heard.range_m * heard.normal_sd_rad
        head_on = abs(heard.direction_rad) < HEAD_ON_RAD
        if heard.normal_sd_rad > NORMAL_SD_MAX_RAD or (sideways_sd_m > SIDEWAYS_SD_MAX_M and not head_on):
            return None
        direction_rad = axis_rad + heard.direction_rad
        return Echo(
            centre.t_s,
            centre.pose.x_m + heard.range_m * cos(direction_rad),
            centre.pose.y_m + heard.range_m * sin(direction_rad),
            wrap_angle(axis_rad + heard.normal_rad),
            heard.range_m,
            heard.fit_sd_m,
        )

    def _near(self, centre: Sample, other: Sample, half_m: float) -> bool:
        return abs(other.travel_m - centre.travel_m) <= half_m and _turn(centre, other) <= WINDOW_HALF_RAD


def _turn(a: Sample, b: Sample) -> float:
    return abs((b.pose.heading_rad - a.pose.heading_rad + pi) % (2 * pi) - pi)


class Surroundings:
    """Ranges in, echoes and free rays out, for any number and bearing of beams (MMU_SR_05)."""

    def __init__(
        self,
        bearings_rad: tuple[float, ...],
        step_m: float = SONAR_STEP_M,
        beam_half_rad: float = BEAM_HALF_RAD,
        spacing_m: float = 0.0,
    ) -> None:
        """`step_m`: ranges are rounded down to multiples of it; 0 where they are not rounded.

        `spacing_m`: the usual way between two ranges of a beam, where it is long.
        """
        window_m = max(WINDOW_HALF_MAX_M, WINDOW_SAMPLES * spacing_m)
        self._bearings_rad = bearings_rad
        self._half_step_m = step_m / 2
        self._tracks = [BeamTrack(b, Beam(beam_half_rad, step_m), window_m) for b in bearings_rad]
        self._newest_s = [float("-inf")] * len(bearings_rad)
        self._recent: list[deque[float]] = [deque(maxlen=3) for _ in bearings_rad]
        self._ray_poses: list[Pose2 | None] = [None] * len(bearings_rad)
        self._ahead = {i: ApproachTrack(b) for i, b in enumerate(bearings_rad) if abs(b) <= AHEAD_RAD}
        self._approaches: list[Approach] = []
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
            if not measured_s >= self._newest_s[i] + SAMPLE_GAP_S:  # nor when it is no number
                continue
            self._newest_s[i] = measured_s
            pose = pose_at(poses, measured_s)
            track = self._tracks[i]
            heard = isfinite(range_m) and range_m > 0
            self._recent[i].append(range_m if heard else float("inf"))
            if heard:
                behind_m = pose.distance_m(newest)
                sample = Sample(measured_s, pose, range_m + self._half_step_m, self._travel_m - behind_m)
                echoes += track.add(sample)
                self._approach(i, sample)
            else:
                echoes += track.miss()
            if len(self._recent[i]) == 3 and self._ray_due(i, pose):
                rays.append(Ray(measured_s, pose, self._bearings_rad[i], sorted(self._recent[i])[1]))
        return echoes, rays

    def take_approaches(self) -> list[Approach]:
        """Those that ended since the last call."""
        done, self._approaches = self._approaches, []
        return done

    def _approach(self, beam: int, sample: Sample) -> None:
        track = self._ahead.get(beam)
        if track is not None and sample.range_m > SONAR_RANGE_MIN_M + 2 * self._half_step_m:
            done = track.add(sample.t_s, sample.pose, sample.range_m)
            if done is not None:
                self._approaches.append(done)

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
