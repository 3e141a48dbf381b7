"""What lies beyond a frontier, and the corners that no sonar heard."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from common.geometry import Points, Pose2
from onboard.planner.exploration.corner_closing import closed_corners
from onboard.planner.exploration.frontiers import FrontierGroup, groups, worth_a_visit
from onboard.planner.exploration.unknown_floor import UnknownFloor
from onboard.planner.grid.grid_map import GridMap
from onboard.planner.grid.recent import RecentResults
from tests.unit.test_planner_grid_map import Box, drawn

NOTHING: Points = np.zeros((0, 2))
# A hall along x, 3 m wide, driven from the left to x = 7; its end wall, at x = 8, has echoed straight ahead only
HALL: list[Box] = [(1.0, 1.9, 7.0, 2.0), (1.0, 5.0, 7.0, 5.1), (0.9, 1.9, 1.0, 5.1), (8.0, 3.3, 8.1, 3.7)]
SEEN: list[Box] = [(1.0, 2.0, 7.0, 5.0), (7.0, 2.9, 8.0, 4.1)]
SOUTH, NORTH = (7.5, 1.95), (7.5, 5.05)


def trail(to_x_m: float = 7.0) -> Points:
    x = np.arange(1.5, to_x_m, 0.1)
    return np.stack([x, np.full_like(x, 3.5)], axis=1)


def listed(grid: GridMap, drive: Points) -> list[FrontierGroup]:
    frontier = worth_a_visit(grid, np.zeros(grid.cells.shape, dtype=bool), Pose2(3.0, 3.5, 0.0))
    return groups(frontier, UnknownFloor(grid, drive))


def is_closed(grid: GridMap, drive: Points, at: tuple[float, float]) -> bool:
    driven = np.zeros(grid.cells.shape, dtype=bool)
    driven[tuple(grid.cells_of(drive).T)] = True
    return bool(closed_corners(grid.cells, driven, np.zeros_like(driven))[grid.cell(*at)])


def test_the_far_corners_of_a_hall_that_was_driven_to_its_end_are_no_entry() -> None:
    grid = drawn(SEEN, HALL)
    assert is_closed(grid, trail(), SOUTH)
    assert is_closed(grid, trail(), NORTH)
    assert listed(grid, trail()) == []


@pytest.mark.requirement("PLN_MR_01")
def test_a_side_hall_beside_the_end_whose_mouth_was_passed_is_one() -> None:
    """Abeam of the gap a wall would have echoed."""
    walls = [*HALL[1:], (1.0, 1.9, 5.8, 2.0)]
    grid = drawn(SEEN, walls)
    assert not is_closed(grid, trail(), (6.5, 1.95))
    assert is_closed(grid, trail(), NORTH)
    (entry,) = listed(grid, trail())
    assert entry.y_m < 3.5


@pytest.mark.requirement("PLN_MR_01")
def test_a_side_hall_beside_the_end_is_one_though_little_of_its_mouth_was_passed() -> None:
    walls = [*HALL[1:], (1.0, 1.9, 6.6, 2.0)]
    assert not is_closed(drawn(SEEN, walls), trail(), (7.5, 1.95))
    (entry,) = listed(drawn(SEEN, walls), trail())
    assert entry.y_m < 3.5


def test_a_robot_that_turns_away_before_the_end_passes_no_mouth() -> None:
    """Nothing echoes to a sonar that does not look straight at a wall."""
    walls = [*HALL[1:], (1.0, 1.9, 6.6, 2.0)]
    turning = np.stack([np.arange(6.6, 7.1, 0.1), np.arange(3.5, 4.0, 0.1)], axis=1)
    assert listed(drawn(SEEN, walls), np.concatenate([trail(6.6), turning])) == []


@pytest.mark.requirement("PLN_MR_01")
def test_an_end_that_nobody_has_seen_is_an_entry() -> None:
    (entry,) = listed(drawn([(1.0, 2.0, 7.0, 5.0)], HALL[:3]), trail(6.0))
    assert entry.x_m == pytest.approx(6.95)


def test_a_patch_that_the_footprint_does_not_fit_into_is_no_entry() -> None:
    cells = drawn([(1.0, 2.0, 7.0, 5.0)], [*HALL[:3], (7.0, 1.9, 7.1, 5.1)])
    assert listed(cells, NOTHING) == []
    cells.cells[30:36, 40:44] = 0  # unknown
    assert listed(cells, NOTHING) == []


def test_what_lies_beyond_is_looked_for_again_only_where_something_changed() -> None:
    computed: list[int] = []

    def total(cells: npt.NDArray[np.int64]) -> float:
        computed.append(1)
        return float(cells.sum())

    recent, cells = RecentResults(), np.arange(6)
    for _ in range(3):
        recent.turn()
        assert recent.of(total, cells) == 15.0
    assert len(computed) == 1
    assert recent.of(total, cells.reshape(2, 3)) == recent.of(total, cells + 1) - 6.0
    assert len(computed) == 3
    recent.turn()
    recent.turn()  # nobody asked in between
    recent.of(total, cells)
    assert len(computed) == 4
