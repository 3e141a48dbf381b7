"""The run of ranges of one sonar that belong to one thing: where its echoes lie.

A sonar receives an echo of a wall anywhere in its beam, so a single range does not show where the wall is. A run of
ranges from a moving robot does (`echo_direction`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin

import numpy as np

from common.constants import SONAR_RANGE_MIN_M
from common.geometry import FloatArray, Pose2, wrap_angle
from onboard.mmu.front_end.echo_direction import Beam, locate

# Over which samples a direction is fitted. The sensitivity was not measured
WINDOW_HALF_M = 0.25  # travel before and after a sample
WINDOW_HALF_RAD = radians(35.0)
WINDOW_SAMPLES = 2.2  # to each side, at least: a slow sonar on a fast robot needs a longer window
WINDOW_HALF_MAX_M = 0.6  # where it is not known that ranges lie further apart
BASELINE_MIN_M = 0.18
BASELINE_MIN_RAD = radians(12.0)
SAMPLES_MIN = 4
SAMPLES_KEPT = 160

# Which echoes are kept. The sensitivity was not measured
ECHO_EVERY_M = 0.05  # two on a cell of the grid; denser echoes of one sonar add nothing
ECHO_EVERY_RAD = radians(6.0)
SIDEWAYS_SD_MAX_M = 0.15  # an echo whose place along the wall is less certain is dropped
NORMAL_SD_MAX_RAD = radians(8.0)
HEAD_ON_RAD = radians(20.0)

# When a run ends, and what is standing still. The sensitivity was not measured
MISSES_MAX = 3
STANDING_M = 0.002
STANDING_RAD = radians(1.0)


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


@dataclass(slots=True)
class BeamTrack:
    """`add` or `miss` for every range; what comes back are the echoes whose place is known now."""

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
        """A range changes by no more than the path in between, but for rounding and noise."""
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
        path_m = near[-1].travel_m - near[0].travel_m
        if path_m < BASELINE_MIN_M and _turn(near[0], near[-1]) < BASELINE_MIN_RAD:
            return None
        axis_rad = centre.pose.heading_rad + self.bearing_rad
        c, s = cos(axis_rad), sin(axis_rad)
        here = centre.pose
        place = np.array([(n.pose.x_m - here.x_m, n.pose.y_m - here.y_m) for n in near])
        at = place @ np.array([[c, -s], [s, c]])
        turned = np.array([wrap_angle(n.pose.heading_rad - here.heading_rad) for n in near])
        found = locate(self.beam, self.normals, at, turned, np.array([n.range_m for n in near]), index - first)
        if found is None:
            return None
        sideways_sd_m = found.range_m * found.normal_sd_rad
        head_on = abs(found.direction_rad) < HEAD_ON_RAD
        if found.normal_sd_rad > NORMAL_SD_MAX_RAD or (sideways_sd_m > SIDEWAYS_SD_MAX_M and not head_on):
            return None
        direction_rad = axis_rad + found.direction_rad
        return Echo(
            centre.t_s,
            centre.pose.x_m + found.range_m * cos(direction_rad),
            centre.pose.y_m + found.range_m * sin(direction_rad),
            wrap_angle(axis_rad + found.normal_rad),
            found.range_m,
            found.fit_sd_m,
        )

    def _near(self, centre: Sample, other: Sample, half_m: float) -> bool:
        return abs(other.travel_m - centre.travel_m) <= half_m and _turn(centre, other) <= WINDOW_HALF_RAD


def _turn(a: Sample, b: Sample) -> float:
    return abs(wrap_angle(b.pose.heading_rad - a.pose.heading_rad))
