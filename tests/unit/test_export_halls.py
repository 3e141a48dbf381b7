"""Areas of halls: a T of two halls whose sizes are known, straight and turned, as the robot's sonars would see it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from common.geometry import Points, Pose2
from offboard.export.halls import SMALLEST_M2, Space, find_spaces
from offboard.export.occupancy_image import occupancy_image
from offboard.export.wall_lines import wall_lines

# A hall of 20 m by 2.4 m along x, and one of 8 m by 1.6 m that leaves it upwards from x 12 to 13.6
LONG_M2, SIDE_M2 = 20.0 * 2.4, 8.0 * 1.6
CORNERS = ((0, 0), (20, 0), (20, 2.4), (13.6, 2.4), (13.6, 10.4), (12, 10.4), (12, 2.4), (0, 2.4), (0, 0))
GAP_M = 0.2  # between what beams passed and the wall


def along(corners: Points, step_m: float) -> Points:
    parts = [
        a + np.arange(0.0, np.hypot(*(b - a)), step_m)[:, None] * (b - a) / np.hypot(*(b - a))
        for a, b in pairwise(corners)
    ]
    return np.concatenate(parts)


def filled(x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> Points:
    """Points of a grid in a rectangle, as often as it takes to count as free."""
    xs, ys = np.arange(x0_m, x1_m, 0.025), np.arange(y0_m, y1_m, 0.025)
    return np.tile(np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2), (3, 1))


def spaces_of(turn_rad: float, behind_m: Points | None = None) -> list[Space]:
    """`behind_m`: places beyond a wall that beams passed."""
    turn = Pose2(0.0, 0.0, turn_rad)
    walls = turn.transform(along(np.array(CORNERS, dtype=np.float64), 0.08))
    seen = [
        filled(GAP_M, GAP_M, 20 - GAP_M, 2.4 - GAP_M),
        filled(12 + GAP_M, 2.0, 13.6 - GAP_M, 10.4 - GAP_M),
        *([] if behind_m is None else [behind_m]),
    ]
    path = turn.transform(along(np.array([(1.0, 1.2), (12.8, 1.2), (12.8, 9.5)]), 0.1))
    image = occupancy_image(walls, path, turn.transform(np.concatenate(seen)))
    return find_spaces(image, wall_lines(walls), path)


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, 30.0, -40.0])
def test_each_hall_has_its_area_within_three_percent_whichever_way_the_robot_started(turn_deg: float) -> None:
    long, side = spaces_of(np.radians(turn_deg))
    assert [long.kind, side.kind] == ["hall", "hall"]
    assert long.area_m2 + side.area_m2 == pytest.approx(LONG_M2 + SIDE_M2, rel=0.03)
    assert long.area_m2 == pytest.approx(LONG_M2, rel=0.05)
    assert long.width_m == pytest.approx(2.4, abs=0.1)
    assert side.width_m == pytest.approx(1.6, abs=0.1)


def test_a_place_belongs_to_one_hall_and_a_door_to_the_hall_that_it_opens_to() -> None:
    long, side = spaces_of(0.0)
    assert [long.distance_m(5.0, 1.2), side.distance_m(12.8, 8.0)] == [0.0, 0.0]
    assert side.distance_m(5.0, 1.2) > 5.0
    assert long.distance_m(5.0, -0.05) < 0.2
    junction = np.array([hall.distance_m(12.8, 1.2) == 0.0 for hall in (long, side)])
    assert junction.tolist() == [True, False]


def test_what_beams_passed_behind_a_wall_is_no_part_of_a_hall() -> None:
    (long, side) = spaces_of(0.0, behind_m=filled(2.0, 2.7, 9.0, 5.0))
    assert long.area_m2 + side.area_m2 == pytest.approx(LONG_M2 + SIDE_M2, rel=0.03)


def test_an_alcove_belongs_to_the_hall_beside_it() -> None:
    assert all(space.area_m2 >= SMALLEST_M2 for space in spaces_of(0.0))
    assert [space.number for space in spaces_of(0.0)] == [1, 2]
