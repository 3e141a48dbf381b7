"""Straight legs along a hall, and the building's own directions."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import Points, Pose2
from onboard.planner.driving.hall_following import DIRECTIONS_MIN, HallFollowing, hall_direction_rad

EAST = 0.0
HERE = Pose2(4.0, 2.0, 0.0)


def wall(bend_deg: float, side_m: float) -> Points:
    """Points of a wall beside the robot, turned by so much."""
    along = np.arange(-2.5, 0.8, 0.05)
    line = np.stack([along, np.full_like(along, side_m)], axis=1)
    return Pose2(0.0, 0.0, radians(bend_deg)).transform(line) + np.array([HERE.x_m, HERE.y_m])


@pytest.mark.parametrize("bend_deg", [0.0, 6.0, -8.0])
@pytest.mark.parametrize("side_m", [-1.0, 1.0])
def test_the_hall_runs_as_its_wall_does(bend_deg: float, side_m: float) -> None:
    direction = hall_direction_rad(wall(bend_deg, side_m), HERE, EAST)
    assert direction == pytest.approx(radians(bend_deg), abs=radians(1.0))


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.random.default_rng(2).uniform(-3.0, 3.0, (200, 2))])
def test_without_a_wall_there_is_no_direction(points: np.ndarray) -> None:
    assert hall_direction_rad(points, Pose2(0.0, 0.0, 0.0), EAST) is None


def test_a_leg_turns_towards_the_wall_beside_it() -> None:
    hall = HallFollowing()
    hall.begin(HERE, EAST)
    for _ in range(40):
        hall.see(wall(6.0, -1.0), HERE)
    assert hall.heading_rad == pytest.approx(radians(6.0), abs=radians(1.0))


def test_ways_are_the_building_s_own_once_enough_of_it_is_known() -> None:
    hall = HallFollowing()
    hall.begin(HERE, EAST)
    assert hall.along(radians(10.0)) == radians(10.0)
    for _ in range(DIRECTIONS_MIN):
        hall.see(wall(4.0, -1.0), HERE)
    assert hall.along(pi / 2 + radians(10.0)) == pytest.approx(pi / 2 + radians(4.0), abs=radians(1.0))
    assert hall.along(radians(45.0)) == pytest.approx(radians(4.0), abs=radians(1.0))
