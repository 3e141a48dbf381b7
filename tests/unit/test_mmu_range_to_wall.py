"""A wall ahead that comes nearer: what of it shows how far the wheels really drove."""

from __future__ import annotations

from math import cos, floor, radians

import numpy as np
import pytest

from common.constants import SONAR_STEP_M
from common.geometry import Pose2
from onboard.mmu.front_end.range_to_wall import RangeToWall, WallAheadTrack

STEP_M = 0.024  # between two pings of a sonar, at mapping speed
WALL_M = 5.0


def drive(
    longer: float = 1.0, path_m: float = 4.0, off_rad: float = 0.0, outliers: int = 0, turn_rad: float = radians(90.0)
) -> list[RangeToWall]:
    """Straight on by `path_m` of odometry, every metre of it `longer` metres, towards a wall that stands `off_rad`
    askew; then a turn. Every so-many-th range is a stray.
    """
    track, found = WallAheadTrack(0.0), []
    count = round(path_m / STEP_M)
    for i in range(count):
        x_m = i * STEP_M
        true_m = WALL_M - longer * x_m * cos(off_rad)
        range_m = 0.8 if outliers and i % outliers == 0 else (floor(true_m / SONAR_STEP_M) + 0.5) * SONAR_STEP_M
        found.append(track.add(float(i), Pose2(x_m, 0.0, 0.0), range_m))
    found.append(track.add(float(count), Pose2(count * STEP_M, 0.0, turn_rad), 3.0))
    return [measured for measured in found if measured is not None]


@pytest.mark.parametrize("longer", [0.98, 0.995, 1.0, 1.01])
@pytest.mark.parametrize("outliers", [0, 7])
def test_the_wall_shows_how_far_the_wheels_really_drove(longer: float, outliers: int) -> None:
    (measured,) = drive(longer, outliers=outliers)
    driven_m = measured.near.x_m - measured.far.x_m
    assert driven_m > 3.0
    assert measured.closer_m == pytest.approx(longer * driven_m, abs=0.006)
    assert measured.far_t_s < measured.near_t_s


def test_a_range_that_is_off_everywhere_by_the_same_measures_the_same() -> None:
    tracks = WallAheadTrack(0.0), WallAheadTrack(0.0)
    for i in range(120):
        for track, off_m in zip(tracks, (0.0, 0.05), strict=True):
            track.add(float(i), Pose2(i * STEP_M, 0.0, 0.0), WALL_M - i * STEP_M + off_m)
    right, off = (track.finish() for track in tracks)
    assert right is not None
    assert off is not None
    assert off.closer_m == pytest.approx(right.closer_m)


def test_a_short_path_measures_nothing() -> None:
    assert drive(path_m=1.2) == []


def test_a_wall_askew_is_none_ahead() -> None:
    assert drive(off_rad=radians(25.0)) == []


def test_the_run_continues_until_the_robot_turns_away() -> None:
    assert drive(turn_rad=radians(3.0)) == []


def test_a_second_wall_behind_the_first_begins_a_new_run() -> None:
    track, found = WallAheadTrack(0.0), []
    for i in range(160):
        x_m = i * STEP_M
        found.append(track.add(float(i), Pose2(x_m, 0.0, 0.0), (3.0 if i < 80 else 5.5) - x_m))
    first = [measured for measured in found if measured is not None]
    second = track.finish()
    assert len(first) == 1
    assert second is not None
    for measured in (first[0], second):
        assert measured.closer_m == pytest.approx(measured.near.x_m - measured.far.x_m, abs=1e-6)
    assert second.far.x_m > first[0].near.x_m


def test_noise_of_the_ranges_averages_out() -> None:
    random = np.random.default_rng(1)
    track = WallAheadTrack(0.0)
    for i in range(150):
        x_m = i * STEP_M
        track.add(float(i), Pose2(x_m, 0.0, 0.0), (WALL_M - x_m) * (1.0 + 0.004 * random.standard_normal()))
    measured = track.finish()
    assert measured is not None
    assert measured.closer_m == pytest.approx(measured.near.x_m - measured.far.x_m, abs=0.015)
