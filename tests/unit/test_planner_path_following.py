"""Following a path that was planned, on drawn floors."""

from __future__ import annotations

import pytest

from common.geometry import Pose2
from common.messages.motion import Speed
from onboard.planner.routing.path_following import Path, arrived, rest_of, speed_along
from tests.unit.test_planner_grid_map import drawn

PATH: Path = [(1.0, 3.0), (2.0, 3.0), (6.0, 3.0)]


@pytest.mark.parametrize(
    ("x_m", "y_m", "left"),
    [(0.5, 3.0, PATH), (0.95, 3.0, PATH[1:]), (1.3, 3.1, PATH[1:]), (1.3, 3.5, PATH)],
    ids=["before", "reached", "passed", "passed too far aside"],
)
def test_a_point_that_was_reached_or_passed_nearby_is_dropped(x_m: float, y_m: float, left: Path) -> None:
    assert rest_of(PATH, Pose2(x_m, y_m, 0.0)) == left


def test_the_last_point_stays_until_it_is_arrived_at() -> None:
    there = Pose2(6.0, 3.0, 0.0)
    assert rest_of(PATH[2:], there) == PATH[2:]
    assert arrived(PATH, there)
    assert not arrived(PATH, Pose2(5.5, 3.0, 0.0))


@pytest.mark.parametrize(
    ("width_m", "heading_rad", "goal", "speed"),
    [
        (3.0, 0.0, (6.0, 3.0), Speed.HIGH),
        (1.0, 0.0, (6.0, 3.0), Speed.MEDIUM),
        (3.0, 0.5, (6.0, 3.0), Speed.MEDIUM),
        (3.0, 0.0, (2.0, 3.0), Speed.MEDIUM),
    ],
    ids=["long, straight and wide", "narrow", "turned away", "short"],
)
def test_only_a_long_straight_leg_in_a_wide_hall_is_driven_fast(
    width_m: float, heading_rad: float, goal: tuple[float, float], speed: Speed
) -> None:
    low, high = 3.0 - width_m / 2, 3.0 + width_m / 2
    grid = drawn([(0.0, low, 8.0, high)], [(0.0, low - 0.1, 8.0, low), (0.0, high, 8.0, high + 0.1)])
    assert speed_along([goal], Pose2(1.0, 3.0, heading_rad), 0.0, grid) is speed
