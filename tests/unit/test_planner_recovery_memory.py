"""What the mission remembers of what did not work."""

from __future__ import annotations

import numpy as np
import pytest

from common.geometry import Pose2
from common.grid_cells import FREE
from onboard.planner.exploration.recovery_memory import (
    BLOCK_FOR_S,
    STAGNANT_S,
    Obstacles,
    Stillness,
    TriedBranches,
    blocked_cells,
)
from onboard.planner.grid.grid_map import GridMap

GRID = GridMap(np.full((40, 40), FREE, np.uint8), 0.0, 0.0, 0.1)
HERE = Pose2(1.0, 2.0, 0.5)


def test_an_obstacle_that_is_met_again_is_remembered_longer() -> None:
    obstacles = Obstacles()
    obstacles.add(2.0, 2.0, 0.0)
    obstacles.forget(BLOCK_FOR_S)
    assert not blocked_cells(GRID, obstacles.places).any()
    obstacles.add(2.1, 2.0, 100.0)
    obstacles.forget(100.0 + BLOCK_FOR_S)
    assert blocked_cells(GRID, obstacles.places)[20, 21]
    assert not blocked_cells(GRID, obstacles.places)[20, 30]


def test_only_an_obstacle_that_is_new_may_hide_a_way() -> None:
    obstacles = Obstacles()
    assert not obstacles.may_hide_a_path(0.0)
    obstacles.add(2.0, 2.0, 0.0)
    assert obstacles.may_hide_a_path(BLOCK_FOR_S - 1.0)
    obstacles.add(2.0, 2.0, BLOCK_FOR_S + 1.0)
    assert not obstacles.may_hide_a_path(BLOCK_FOR_S + 2.0)


@pytest.mark.parametrize(("end", "meets"), [((3.0, 2.0), True), ((3.0, 4.0), False), ((1.2, 2.0), False)])
def test_a_leg_meets_an_obstacle_that_stands_on_it(end: tuple[float, float], meets: bool) -> None:
    obstacles = Obstacles()
    obstacles.add(2.0, 2.0, 0.0)
    assert obstacles.on_leg((1.0, 2.0), end) is meets


@pytest.mark.parametrize("under_way", [True, False])
def test_only_a_robot_that_is_under_way_stagnates_and_is_told_once(under_way: bool) -> None:
    stillness = Stillness()
    told = sum(stillness.stagnates(HERE, 0.1, under_way) for _ in range(int(STAGNANT_S / 0.1) + 10))
    assert told == under_way


def test_a_short_leg_was_in_vain_and_a_long_one_was_not() -> None:
    tried = TriedBranches()
    tried.add_leg(HERE, Pose2(3.0, 2.0, 0.5))
    assert not tried.leg_in_vain(HERE)
    tried.add_leg(HERE, Pose2(1.1, 2.0, 0.5))
    assert tried.leg_in_vain(HERE)
    assert not tried.leg_in_vain(Pose2(1.0, 2.0, 2.0))


def test_a_side_that_was_turned_to_is_tried_and_no_leg_in_vain() -> None:
    tried = TriedBranches()
    tried.add_side(HERE)
    assert tried.tried(Pose2(1.1, 2.0, 0.6))
    assert not tried.leg_in_vain(HERE)
