"""Range features: what the ranges show of walls, apart from how the sonars are wired.

Ranges of all beams -> echoes on walls with normals (`beam_track`; where frames lie far apart `sparse_echoes`), free
rays, ranges to a wall ahead (`range_to_wall`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import cos, inf, isfinite, radians, sin

import numpy as np

from common.constants import SONAR_RANGE_MIN_M, SONAR_STEP_M
from common.geometry import Pose2, wrap_angle
from onboard.mmu.front_end.beam_track import WINDOW_HALF_MAX_M, WINDOW_SAMPLES, BeamTrack, Echo, Sample
from onboard.mmu.front_end.echo_direction import NARROW_RAD, Beam
from onboard.mmu.front_end.range_to_wall import AHEAD_RAD, RangeToWall, WallAheadTrack
from onboard.mmu.front_end.sparse_echoes import SparseEchoes

# Beams and the spacing of rays. The sensitivity was not measured
BEAM_HALF_RAD = radians(38.0)  # of the robot's sonars: half the angle within which a flat wall echoes
RAY_EVERY_M = 0.08
RAY_EVERY_RAD = radians(3.0)
TURNING_RAD = radians(3.0)  # between the newest ranges
# A robot drives along or across walls: what a slanted beam hears lies off its axis, in a corner, behind the wall there
SLANTED_SIN_MIN, UNSURE_FREE_M = 0.7, 1.5
SLANT_MAX_RAD = radians(60.0)  # between two beams, of which one may tell of the other's wall
SPARSE_M = 0.12  # where frames are further apart than this, the beams of several are looked at together
SAMPLE_GAP_S = 0.02  # a range that is not this much newer is the same one again


@dataclass(frozen=True, slots=True)
class Ray:
    """Space that a range showed to be free: from the ring's centre along the beam's axis, `free_m` far (odom)."""

    t_s: float
    pose: Pose2
    bearing_rad: float
    free_m: float


class RangeFeatures:
    """Ranges in, echoes and free rays out, for any number and bearing of beams (MMU_SR_05)."""

    def __init__(
        self,
        bearings_rad: tuple[float, ...],
        step_m: float = SONAR_STEP_M,
        beam_half_rad: float = BEAM_HALF_RAD,
        spacing_m: float = 0.0,
    ) -> None:
        """`step_m`: ranges are rounded down to multiples of it; 0 where they are not rounded.

        `spacing_m`: the usual path between two ranges of a beam, where it is long.
        """
        window_m = max(WINDOW_HALF_MAX_M, WINDOW_SAMPLES * spacing_m)
        self._bearings_rad = bearings_rad
        self._half_step_m = step_m / 2
        self._tracks = [BeamTrack(b, Beam(beam_half_rad, step_m), window_m) for b in bearings_rad]
        self._newest_s = [float("-inf")] * len(bearings_rad)
        self._recent: list[deque[float]] = [deque(maxlen=3) for _ in bearings_rad]
        self._headings: list[deque[float]] = [deque(maxlen=3) for _ in bearings_rad]  # at the recent ranges
        self._wide = beam_half_rad > NARROW_RAD
        self._slanted = [self._wide and abs(sin(2 * bearing)) > SLANTED_SIN_MIN for bearing in bearings_rad]
        self._ray_poses: list[Pose2 | None] = [None] * len(bearings_rad)
        self._ray_turned = [False] * len(bearings_rad)  # the newest ray, or the one it would have been
        self._beside = [_beside(i, bearings_rad, beam_half_rad) for i in range(len(bearings_rad))]
        self._ahead = {i: WallAheadTrack(b) for i, b in enumerate(bearings_rad) if abs(b) <= AHEAD_RAD}
        self._ranges_to_wall: list[RangeToWall] = []
        self._travel_m = 0.0
        self._last_pose: Pose2 | None = None
        self._sparse = SparseEchoes(bearings_rad, spacing_m) if spacing_m > SPARSE_M else None

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
            if not measured_s >= self._newest_s[i] + SAMPLE_GAP_S:  # also where it is no number
                continue
            self._newest_s[i] = measured_s
            pose = pose_at(poses, measured_s)
            track = self._tracks[i]
            echoed = isfinite(range_m) and range_m > 0
            self._recent[i].append(range_m if echoed else float("inf"))
            self._headings[i].append(pose.heading_rad)
            if echoed:
                behind_m = pose.distance_m(newest)
                sample = Sample(measured_s, pose, range_m + self._half_step_m, self._travel_m - behind_m)
                if self._sparse is None:
                    echoes += track.add(sample)
                self._track_wall_ahead(i, sample)
            elif self._sparse is None:
                echoes += track.miss()
            turns = self._turns(i)
            if len(self._recent[i]) == 3 and self._ray_due(i, pose, turns):
                free_m = min([self._median_m(i), *(self._median_m(j) * far for j, far in self._beside[i])])
                if turns or self._slanted[i]:
                    free_m = min(free_m, UNSURE_FREE_M)
                rays.append(Ray(measured_s, pose, self._bearings_rad[i], free_m))
        if self._sparse is not None:
            echoes += self._sparse.add(t_s, newest, np.array(ranges_m) + self._half_step_m)
        return echoes, rays

    def _median_m(self, beam: int) -> float:
        """Of the newest ranges; infinite where there are too few."""
        recent = self._recent[beam]
        return sorted(recent)[1] if len(recent) == 3 else inf

    def take_ranges_to_wall(self) -> list[RangeToWall]:
        """Those that ended since the last call."""
        done, self._ranges_to_wall = self._ranges_to_wall, []
        return done

    def _track_wall_ahead(self, beam: int, sample: Sample) -> None:
        track = self._ahead.get(beam)
        if track is not None and sample.range_m > SONAR_RANGE_MIN_M + 2 * self._half_step_m:
            done = track.add(sample.t_s, sample.pose, sample.range_m)
            if done is not None:
                self._ranges_to_wall.append(done)

    def _turns(self, beam: int) -> bool:
        """The newest ranges came while it turned: a wide beam hears the same wall, wherever its axis points."""
        first, *others = self._headings[beam]
        return self._wide and any(abs(wrap_angle(heading - first)) > TURNING_RAD for heading in others)

    def _ray_due(self, beam: int, pose: Pose2, turns: bool) -> bool:
        """From where the last ray came nothing new is in view."""
        if self._ray_turned[beam] and not turns:
            self._ray_poses[beam] = None
        self._ray_turned[beam] = turns
        last = self._ray_poses[beam]
        turned_rad = abs(wrap_angle(pose.heading_rad - last.heading_rad)) if last is not None else RAY_EVERY_RAD
        if last is not None and last.distance_m(pose) < RAY_EVERY_M and turned_rad < RAY_EVERY_RAD:
            return False
        self._ray_poses[beam] = pose
        return True


def _beside(beam: int, bearings_rad: tuple[float, ...], beam_half_rad: float) -> list[tuple[int, float]]:
    """Which beams tell how far this one can see at most, and how many times what they measure.

    A wall that one beam meets squarely goes on, most often, and the beam beside it meets that at such a slant that it
    does not echo: what does echo, a corner off its axis, would make its ray pass through the wall.
    """
    offs = ((j, abs(wrap_angle(bearing - bearings_rad[beam]))) for j, bearing in enumerate(bearings_rad))
    wide = NARROW_RAD < beam_half_rad < SLANT_MAX_RAD
    return [(j, 1.0 / cos(off)) for j, off in offs if wide and beam_half_rad < off < SLANT_MAX_RAD]


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
