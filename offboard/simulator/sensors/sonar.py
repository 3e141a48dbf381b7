"""Echoes of an LV-MaxSonar-EZ1 among walls and people: transducer pose -> range of the first echo -> pulse width.

`EchoModel` is the physics on 2D wall segments, `SonarBank` the five sensors with what disturbs them.

Sources: planes, corners and edges as reflectors, Kuc & Siegel, "Physically based simulation model for acoustic sensor
robot navigation", IEEE PAMI 9 (1987); Leonard & Durrant-Whyte, "Directed Sonar Sensing" (1992). Ranges, steps and
times: MaxBotix datasheet PD11832. Assumptions (no sheet gives them): two-way Gaussian beam of 17 degrees, amplitude
falling with 1 / range such that a wide flat wall gives the last echo at 6.4 m, edges and corners 18 dB below a wall.

1. A smooth wall reflects only at the foot of the perpendicular, if the foot lies on it and in the beam.
2. A corner (convex or concave) reflects from any angle, weakly; so does a person, as a cylinder in clothes.
3. A nearer wall hides what is behind it. The first echo above the threshold wins; nothing above it is no echo.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, inf, log, log10, pi, radians, sin
from random import Random

import numpy as np

from common.constants import (
    SONAR_BEARINGS_RAD,
    SONAR_MAX_M,
    SONAR_MIN_M,
    SONAR_RING_RADIUS_M,
    SONAR_STEP_M,
)
from common.geometry import FloatArray
from offboard.simulator.building.polygons import distances_m
from offboard.simulator.error_profiles import ErrorProfile

US_PER_INCH = 147
NO_ECHO_US = 37500
BEAM_SIGMA_RAD = radians(17.0)
CORNER_LOSS_DB = 18.0
PERSON_LOSS_DB = 8.0
SMOOTH_BEND_RAD = radians(10.0)  # a bend below this is no corner
WIDE_WALL_M = 0.2  # first Fresnel zone at about 2.4 m: a narrower facet returns in proportion

_BUCKET_M = 1.0
_WALL_REACH_M = 7.0
_CORNER_REACH_M = 2.5  # further away even a corner on the axis is 8 dB below the threshold
_BEAM_EDGE_RAD = radians(62.0)  # further off axis even a wall at the least range is 25 dB below the threshold
_BEAM_LOSS_DB = 10.0 / log(10.0) / BEAM_SIGMA_RAD**2  # times the squared angle off axis
_TARGET_MARGIN_M = 0.01
_ROUNDING_M = 1e-9
_MIN_INCHES = round(SONAR_MIN_M / SONAR_STEP_M)
_MAX_INCHES = round(SONAR_MAX_M / SONAR_STEP_M)

Circle = tuple[float, float, float]  # x_m, y_m, radius_m


class EchoModel:
    """The walls of a floor as reflectors. Each square metre of floor has a bucket of the reflectors that it can see."""

    def __init__(self, segments: FloatArray) -> None:
        """`segments` (N, 4): walls in metres, each with the free space on its left."""
        self._segments = segments
        self._corners = _corners(segments)  # (K, 2)
        self._buckets: dict[tuple[int, int], _Bucket] = {}

    def first_echo_m(
        self, x_m: float, y_m: float, bearing_rad: float, gain_db: float = 0.0, people: Sequence[Circle] = ()
    ) -> float:
        """Distance from a transducer at (x_m, y_m) with its axis along `bearing_rad` to the first echo, or infinity.

        `gain_db` shifts the threshold of this ping; `people` stand beside the walls.
        """
        return self._bucket(x_m, y_m).first_echo_m(x_m, y_m, bearing_rad, gain_db, people)

    def wall_ahead_m(self, x_m: float, y_m: float, bearing_rad: float) -> float:
        """Distance along one straight line to the nearest wall within 7 m, or infinity."""
        return self._bucket(x_m, y_m).wall_ahead_m(x_m, y_m, bearing_rad)

    def _bucket(self, x_m: float, y_m: float) -> _Bucket:
        key = int(x_m // _BUCKET_M), int(y_m // _BUCKET_M)
        bucket = self._buckets.get(key)
        if bucket is None:
            bucket = self._buckets[key] = self._made_bucket(key)
        return bucket

    def _made_bucket(self, key: tuple[int, int]) -> _Bucket:
        centre_x_m, centre_y_m = (key[0] + 0.5) * _BUCKET_M, (key[1] + 0.5) * _BUCKET_M
        near = distances_m(self._segments, centre_x_m, centre_y_m) < _WALL_REACH_M + _BUCKET_M
        corners = self._corners
        near_corners = np.hypot(corners[:, 0] - centre_x_m, corners[:, 1] - centre_y_m) < _CORNER_REACH_M + _BUCKET_M
        return _Bucket(self._segments[near], corners[near_corners].tolist())


class _Bucket:
    """The walls and corners in reach of one square metre of floor; walls as straight lines in normal form."""

    def __init__(self, segments: FloatArray, corners: list[list[float]]) -> None:
        start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
        length_m = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
        unit = along / length_m[:, None]
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        self._length_m = length_m
        # One product gives both coordinates of a point seen from every wall: (2N, 3) @ (x, y, 1)
        self._lines = np.vstack(
            [
                np.column_stack([normal, -(normal * start).sum(1)]),
                np.column_stack([unit, -(unit * start).sum(1)]),
            ]
        )
        self._count = len(segments)
        self._bearing_to_foot_rad: list[float] = np.arctan2(-normal[:, 1], -normal[:, 0]).tolist()
        self._facet_loss_db = (-20.0 * np.log10(np.clip(length_m / WIDE_WALL_M, 1e-3, 1.0))).tolist()
        self._corners = corners

    def _seen_from_walls(self, x_m: float, y_m: float) -> tuple[FloatArray, FloatArray]:
        """Signed distance from every wall's line (positive on the free side), and position along it."""
        both = self._lines @ np.array((x_m, y_m, 1.0))
        return both[: self._count], both[self._count :]

    def first_echo_m(
        self, x_m: float, y_m: float, bearing_rad: float, gain_db: float, people: Sequence[Circle]
    ) -> float:
        off_wall_m, along_m = self._seen_from_walls(x_m, y_m)
        answering = (off_wall_m > 0.0) & (along_m >= 0.0) & (along_m <= self._length_m)
        targets = []
        for i in answering.nonzero()[0].tolist():
            to_foot_rad = self._bearing_to_foot_rad[i]
            off_axis_rad = (to_foot_rad - (bearing_rad - pi)) % (2.0 * pi) - pi
            if not -_BEAM_EDGE_RAD < off_axis_rad < _BEAM_EDGE_RAD:
                continue
            range_m = float(off_wall_m[i])
            if _level_db(range_m, off_axis_rad, self._facet_loss_db[i]) + gain_db > 0.0:
                targets.append((range_m, x_m + range_m * cos(to_foot_rad), y_m + range_m * sin(to_foot_rad)))
        reach_m = SONAR_MAX_M * 10.0 ** ((gain_db - CORNER_LOSS_DB) / 20.0)  # beyond not even on the axis
        for corner_x_m, corner_y_m in self._corners:
            dx_m, dy_m = corner_x_m - x_m, corner_y_m - y_m
            range_m = hypot(dx_m, dy_m)
            if range_m > reach_m + _ROUNDING_M:
                continue
            if _level_db(range_m, atan2(dy_m, dx_m) - bearing_rad, CORNER_LOSS_DB) + gain_db > 0.0:
                targets.append((range_m, corner_x_m, corner_y_m))
        for person_x_m, person_y_m, radius_m in people:
            dx_m, dy_m = person_x_m - x_m, person_y_m - y_m
            centre_m = max(hypot(dx_m, dy_m), 1e-6)
            range_m = max(centre_m - radius_m, 0.0)
            if _level_db(range_m, atan2(dy_m, dx_m) - bearing_rad, PERSON_LOSS_DB) + gain_db > 0.0:
                targets.append((range_m, x_m + dx_m * range_m / centre_m, y_m + dy_m * range_m / centre_m))
        for range_m, target_x_m, target_y_m in sorted(targets):
            if not self._hidden(off_wall_m, along_m, (x_m, y_m), (target_x_m, target_y_m), people):
                return range_m
        return inf

    def _hidden(
        self,
        off_wall_m: FloatArray,
        along_m: FloatArray,
        eye: tuple[float, float],
        target: tuple[float, float],
        people: Sequence[Circle],
    ) -> bool:
        """Whether a wall or a person stands between the transducer and the target."""
        behind_m, target_along_m = self._seen_from_walls(*target)
        for i in ((off_wall_m > 0.0) & (behind_m < -_TARGET_MARGIN_M)).nonzero()[0].tolist():
            share = float(off_wall_m[i] / (off_wall_m[i] - behind_m[i]))
            crossing_m = float(along_m[i] + share * (target_along_m[i] - along_m[i]))
            if 0.0 <= crossing_m <= self._length_m[i]:
                return True
        return any(_blocks(person, eye, target) for person in people)

    def wall_ahead_m(self, x_m: float, y_m: float, bearing_rad: float) -> float:
        off_wall_m, along_m = self._seen_from_walls(x_m, y_m)
        far_off_m, far_along_m = self._seen_from_walls(
            x_m + _WALL_REACH_M * cos(bearing_rad), y_m + _WALL_REACH_M * sin(bearing_rad)
        )
        nearest = inf
        for i in ((off_wall_m > 0.0) & (far_off_m < 0.0)).nonzero()[0].tolist():
            share = float(off_wall_m[i] / (off_wall_m[i] - far_off_m[i]))
            if 0.0 <= along_m[i] + share * (far_along_m[i] - along_m[i]) <= self._length_m[i]:
                nearest = min(nearest, share * _WALL_REACH_M)
        return nearest


def _blocks(person: Circle, eye: tuple[float, float], target: tuple[float, float]) -> bool:
    """Whether the straight line to the target runs through a person (not: ends on the person's skin)."""
    dx_m, dy_m = target[0] - eye[0], target[1] - eye[1]
    length2 = max(dx_m * dx_m + dy_m * dy_m, 1e-9)
    share = ((person[0] - eye[0]) * dx_m + (person[1] - eye[1]) * dy_m) / length2
    share = min(max(share, 0.0), 1.0)
    gap_m = hypot(person[0] - eye[0] - share * dx_m, person[1] - eye[1] - share * dy_m)
    return gap_m < person[2] - _TARGET_MARGIN_M


def _corners(segments: FloatArray) -> FloatArray:
    """(K, 2): the points where walls meet at an angle, and the free ends of walls."""
    directions: dict[tuple[int, int], list[float]] = {}
    points: dict[tuple[int, int], tuple[float, float]] = {}
    for x0, y0, x1, y1 in segments.tolist():
        direction_rad = atan2(y1 - y0, x1 - x0) % pi
        for x_m, y_m in ((x0, y0), (x1, y1)):
            key = round(x_m * 1e4), round(y_m * 1e4)
            points[key] = x_m, y_m
            directions.setdefault(key, []).append(direction_rad)
    corners = []
    for key, angles in directions.items():
        bend_rad = max(min(abs(a - angles[0]), pi - abs(a - angles[0])) for a in angles)
        if len(angles) == 1 or bend_rad > SMOOTH_BEND_RAD:
            corners.append(points[key])
    return np.array(corners, dtype=np.float64).reshape(-1, 2)


def _level_db(range_m: float, off_axis_rad: float, loss_db: float) -> float:
    """How far an echo is above the threshold."""
    off_rad = (off_axis_rad + pi) % (2.0 * pi) - pi
    return 20.0 * log10(SONAR_MAX_M / max(range_m, SONAR_MIN_M)) - _BEAM_LOSS_DB * off_rad * off_rad - loss_db


def pulse_width_us(range_m: float) -> int:
    """The pulse of a range: whole inches, 6 for anything nearer, NO_ECHO_US beyond 254."""
    if range_m == inf:
        return NO_ECHO_US
    inches = max(int(range_m / SONAR_STEP_M + 1e-9), _MIN_INCHES)
    return inches * US_PER_INCH if inches <= _MAX_INCHES else NO_ECHO_US


class SonarBank:
    """The five sensors on their ring, with the errors of a profile."""

    def __init__(self, profile: ErrorProfile, rng: Random) -> None:
        self._profile, self._rng = profile, rng
        self._noisy = profile.sonar_gain_sd_db > 0.0

    def ping(
        self,
        model: EchoModel,
        pose: Sequence[float],
        fired: Sequence[int],
        people: Sequence[Circle] = (),
    ) -> list[tuple[int, int]]:
        """(sonar, pulse width in microseconds) of those fired together; `pose`: x_m, y_m, heading_rad of the robot."""
        ranges_m = {}
        for sonar in fired:
            bearing_rad = pose[2] + SONAR_BEARINGS_RAD[sonar]
            x_m = pose[0] + SONAR_RING_RADIUS_M * cos(bearing_rad)
            y_m = pose[1] + SONAR_RING_RADIUS_M * sin(bearing_rad)
            gain_db = self._rng.gauss(0.0, self._profile.sonar_gain_sd_db) if self._noisy else 0.0
            ranges_m[sonar] = model.first_echo_m(x_m, y_m, bearing_rad, gain_db, people)
        return [(sonar, pulse_width_us(self._disturbed_m(sonar, ranges_m))) for sonar in ranges_m]

    def _disturbed_m(self, sonar: int, ranges_m: dict[int, float]) -> float:
        range_m, profile, rng = ranges_m[sonar], self._profile, self._rng
        if not self._noisy:
            return range_m
        if len(ranges_m) > 1 and rng.random() < profile.sonar_cross_talk:
            range_m = min(range_m, rng.choice([ranges_m[other] for other in ranges_m if other != sonar]))
        if rng.random() < profile.sonar_early:
            range_m = rng.uniform(SONAR_MIN_M, min(range_m, SONAR_MAX_M))
        if rng.random() < profile.sonar_loss:
            return inf
        return range_m if range_m == inf else range_m * (1.0 + rng.gauss(0.0, profile.sonar_range_sd))
