"""Echoes of frames that lie far apart: the beams of several frames together show where a wall lies."""

from __future__ import annotations

from math import cos, degrees, inf, pi, radians, sin

import numpy as np
import pytest

from common.geometry import Pose2, wrap_angle
from onboard.mmu.front_end.beam_track import Echo
from onboard.mmu.front_end.sparse_echoes import SparseEchoes

BEARINGS_RAD = tuple(radians(b) for b in (90.0, 45.0, 0.0, -45.0, -90.0))
HALF_WIDTH_M = 1.2  # of the hall, whose end lies at END_M
END_M = 9.0
RANGE_MAX_M = 5.0


def ranges_m(pose: Pose2) -> list[float]:
    """Of pencil beams in a hall along x with walls at y = 1.2 and -1.2 and an end."""
    ranges = []
    for bearing_rad in BEARINGS_RAD:
        c, s = cos(pose.heading_rad + bearing_rad), sin(pose.heading_rad + bearing_rad)
        along = (END_M - pose.x_m) / c if c > 1e-9 else inf
        across = ((HALF_WIDTH_M if s > 0 else -HALF_WIDTH_M) - pose.y_m) / s if abs(s) > 1e-9 else inf
        ranges.append(min(along, across))
    return [r if r < RANGE_MAX_M else inf for r in ranges]


def driven(spacing_m: float, frames: int, turn_rad: float = 0.0) -> list[Echo]:
    features = SparseEchoes(BEARINGS_RAD, spacing_m)
    echoes: list[Echo] = []
    for i in range(frames):
        pose = Pose2(i * spacing_m, 0.1 * sin(i), i * turn_rad)
        echoes += features.add(float(i), pose, np.array(ranges_m(pose)))
    return echoes


@pytest.mark.parametrize("spacing_m", [0.4, 0.8, 1.0])
def test_walls_of_a_hall_are_found_by_frames_half_a_metre_and_more_apart(spacing_m: float) -> None:
    echoes = driven(spacing_m, round(6.0 / spacing_m) + 1)
    beside = [e for e in echoes if abs(e.x_m - END_M) > 0.1]
    assert len(beside) >= 4 * (round(6.0 / spacing_m) - 4) * 0.8
    assert max(abs(abs(e.y_m) - HALF_WIDTH_M) for e in beside) < 0.01
    assert max(degrees(abs(wrap_angle(e.normal_rad - (pi / 2 if e.y_m > 0 else -pi / 2)))) for e in beside) < 2.0


def test_a_robot_that_stands_shows_nothing_new() -> None:
    features = SparseEchoes(BEARINGS_RAD, 0.8)
    pose = Pose2(0.0, 0.0, 0.0)
    assert not any(features.add(float(i), pose, np.array(ranges_m(pose))) for i in range(20))


def test_frames_without_any_echo_show_no_walls() -> None:
    features = SparseEchoes(BEARINGS_RAD, 0.8)
    assert not any(features.add(float(i), Pose2(0.8 * i, 0.0, 0.0), np.full(5, np.nan)) for i in range(20))


def test_places_off_any_line_are_no_wall() -> None:
    rng = np.random.default_rng(3)
    features = SparseEchoes(BEARINGS_RAD, 0.8)
    echoes = [
        echo for i in range(30) for echo in features.add(float(i), Pose2(0.8 * i, 0, 0), rng.uniform(0.5, 4.5, 5))
    ]
    assert len(echoes) < 0.35 * 5 * 26
