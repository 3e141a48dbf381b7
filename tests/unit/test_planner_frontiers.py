"""What is still to be seen, read off small grids."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import Pose2
from onboard.planner.exploration.frontiers import (
    CONSIDERED_MAX,
    STRAIGHT_MAX_M,
    Frontier,
    FrontierGroup,
    FrontierMemory,
    considered,
    groups,
    opening_on_the_right,
    something_ahead,
    straight_reach_m,
    unknown_direction_rad,
    worth_a_visit,
)
from onboard.planner.exploration.recovery_memory import BLOCK_RADIUS_M
from onboard.planner.exploration.unknown_floor import UnknownFloor
from onboard.planner.grid.grid_map import GridMap
from tests.unit.test_planner_grid_map import drawn, hall

EAST = 0.0


def frontier_of(grid: GridMap) -> Frontier:
    return worth_a_visit(grid, np.zeros(grid.cells.shape, dtype=bool), Pose2(0.0, 0.0, 0.0))


def listed(grid: GridMap, frontier: Frontier) -> list[FrontierGroup]:
    return groups(frontier, UnknownFloor(grid, np.zeros((0, 2))))


def junction(opening_m: float = 2.0) -> GridMap:
    """A hall along x, closed at both ends, with an opening to the south at x = 4 that nobody has visited."""
    x0, x1 = 4.0 - opening_m / 2, 4.0 + opening_m / 2
    return drawn(
        [(1.0, 2.0, 9.0, 4.0), (x0, 1.5, x1, 2.0)],
        [
            (1.0, 4.0, 9.0, 4.1),
            (1.0, 1.9, x0, 2.0),
            (x1, 1.9, 9.0, 2.0),
            (x0 - 0.1, 1.5, x0, 2.0),
            (x1, 1.5, x1 + 0.1, 2.0),
            (0.9, 1.9, 1.0, 4.1),
            (9.0, 1.9, 9.1, 4.1),
        ],
    )


@pytest.mark.requirement("PLN_MR_01")
def test_every_unseen_end_is_one_group_with_its_middle() -> None:
    grid = drawn([(1.0, 2.0, 9.0, 4.0)], [(1.0, 1.9, 9.0, 2.0), (1.0, 4.0, 9.0, 4.1)])
    found = sorted(listed(grid, frontier_of(grid)), key=lambda group: group.x_m)
    assert [group.x_m for group in found] == pytest.approx([1.05, 8.95])
    assert [group.y_m for group in found] == pytest.approx([3.0, 3.0], abs=0.05)


def test_a_closed_floor_has_no_group() -> None:
    grid = hall()
    assert listed(grid, frontier_of(grid)) == []


def test_a_frontier_that_was_given_up_is_not_visited_again_and_others_are() -> None:
    grid = drawn([(1.0, 2.0, 9.0, 4.0)], [(1.0, 1.9, 9.0, 2.0), (1.0, 4.0, 9.0, 4.1)])
    exploration = FrontierMemory()
    for y_m in (2.5, 3.0, 3.5):
        exploration.mark_visited(8.9, y_m)
    nothing = np.zeros(grid.cells.shape, dtype=bool)
    left = listed(grid, worth_a_visit(grid, nothing, Pose2(0.0, 0.0, 0.0), exploration.left_out))
    assert [group.x_m for group in left] == pytest.approx([1.05])


def test_what_is_blocked_is_no_frontier() -> None:
    grid = hall(closed=False)
    assert len(frontier_of(grid).cells)
    assert not len(worth_a_visit(grid, np.ones(grid.cells.shape, dtype=bool), Pose2(0.0, 0.0, 0.0)).cells)


def test_of_too_many_cells_those_around_the_robot_are_considered() -> None:
    grid = drawn([], size_m=(30.0, 30.0))
    mask = np.ones(grid.cells.shape, dtype=bool)
    cells = considered(grid, mask, Pose2(25.0, 5.0, 0.0))
    assert CONSIDERED_MAX / 10 < len(cells) <= CONSIDERED_MAX
    assert np.abs(grid.centres(cells) - np.array([25.0, 5.0])).max() < 5.0
    assert len(considered(grid, mask, Pose2(-500.0, 5.0, 0.0))) <= CONSIDERED_MAX


def test_straight_on_ends_before_the_wall() -> None:
    grid = hall(length_m=5.0)
    assert straight_reach_m(grid, Pose2(2.0, 2.0, 0.0), EAST) == pytest.approx(3.7, abs=0.25)
    assert straight_reach_m(grid, Pose2(2.0, 2.0, 0.0), pi / 2) < 0.9


def test_straight_on_unknown_floor_counts_as_open_and_obstacles_do_not() -> None:
    grid = hall(length_m=2.0, closed=False)
    pose = Pose2(2.0, 2.0, 0.0)
    assert straight_reach_m(grid, pose, EAST) == STRAIGHT_MAX_M
    assert straight_reach_m(grid, pose, EAST, ((3.0, 2.1),)) == pytest.approx(1.0 - BLOCK_RADIUS_M, abs=0.15)
    assert straight_reach_m(grid, pose, EAST, ((3.0, 2.6),)) == STRAIGHT_MAX_M


def test_an_unseen_end_lies_ahead_and_a_seen_one_does_not() -> None:
    grid = hall(length_m=5.0, closed=False)
    assert something_ahead(grid, frontier_of(grid), Pose2(2.0, 2.0, 0.0), EAST, 6.0)
    assert not something_ahead(grid, frontier_of(grid), Pose2(2.0, 2.0, pi), pi, 0.6)
    closed = hall(length_m=5.0)
    assert not something_ahead(closed, frontier_of(closed), Pose2(2.0, 2.0, 0.0), EAST, 4.0)


def test_nothing_lies_ahead_when_there_is_no_room_to_go() -> None:
    grid = hall(length_m=5.0, closed=False)
    assert not something_ahead(grid, frontier_of(grid), Pose2(2.0, 2.0, 0.0), EAST, 0.2)


@pytest.mark.requirement("PLN_MR_01")
def test_an_opening_is_found_though_its_edge_hides_the_inside_from_a_robot_that_has_passed_it() -> None:
    """Of the side hall a fan of floor was seen in passing, up to its end wall; its own walls were not."""
    grid = drawn(
        [(1.0, 2.0, 9.0, 4.0), (3.4, 0.6, 4.6, 2.0)],
        [(1.0, 4.0, 9.0, 4.1), (1.0, 1.9, 3.4, 2.0), (4.6, 1.9, 9.0, 2.0), (3.4, 0.5, 4.6, 0.6), (0.9, 1.9, 1.0, 4.1)],
    )
    here = Pose2(5.2, 3.0, 0.0)
    frontier = frontier_of(grid)
    inside = frontier.points[frontier.points[:, 1] < 1.5]
    assert len(inside)
    assert not grid.sees_each(np.array([here.x_m, here.y_m]), inside).all()
    assert opening_on_the_right(grid, frontier, here, EAST) is not None


@pytest.mark.requirement("PLN_MR_01")
def test_an_opening_on_the_right_is_found_once_it_was_passed() -> None:
    grid = junction()
    frontier = frontier_of(grid)
    assert opening_on_the_right(grid, frontier, Pose2(2.0, 3.0, 0.0), EAST) is None, "not there yet"
    cells = opening_on_the_right(grid, frontier, Pose2(5.5, 3.0, 0.0), EAST)
    assert cells is not None
    centres = grid.centres(cells)
    assert (np.abs(centres[:, 0] - 4.0) < 1.0).all()
    assert (centres[:, 1] < 2.0).all()


def test_an_opening_on_the_left_or_a_slit_is_none_on_the_right() -> None:
    grid = junction()
    assert opening_on_the_right(grid, frontier_of(grid), Pose2(2.5, 3.0, pi), pi) is None
    slit = junction(opening_m=0.3)
    assert opening_on_the_right(slit, frontier_of(slit), Pose2(5.5, 3.0, 0.0), EAST) is None


def test_a_closed_hall_has_no_opening() -> None:
    grid = hall()
    assert opening_on_the_right(grid, frontier_of(grid), Pose2(5.0, 2.0, 0.0), EAST) is None


def test_at_an_unseen_end_the_unknown_floor_lies_ahead() -> None:
    grid = hall(length_m=5.0, closed=False)
    assert unknown_direction_rad(grid, 5.8, 2.0, fallback_rad=2.0) == pytest.approx(0.0, abs=radians(20.0))


def test_where_all_is_known_the_direction_falls_back() -> None:
    grid = drawn([(0.0, 0.0, 10.0, 6.0)])
    assert unknown_direction_rad(grid, 5.0, 3.0, fallback_rad=1.25) == 1.25
