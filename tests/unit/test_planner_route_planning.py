"""Paths over the known floor: where they lead, what they keep clear of, and when there is none."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.geometry import Pose2
from common.grid_cells import FREE, UNKNOWN, WALL
from onboard.planner.exploration.queries import FindPathBefore
from onboard.planner.grid.deliberation import Grids
from onboard.planner.grid.grid_map import STAND_CLEARANCE_M, Cell, GridMap, Mask
from onboard.planner.routing.reachable import reachable
from onboard.planner.routing.route_planning import (
    TIGHT_CLEARANCE_M,
    TIGHT_PRICE,
    cell_prices,
    pull_string,
    shortest_path,
    straight_is_clear,
)
from tests.unit.test_planner_grid_map import drawn, hall


def path(
    grid: GridMap,
    a: tuple[float, float],
    b: tuple[float, float],
    blocked: Mask | None = None,
) -> list[Cell] | None:
    start, goal = grid.cell(*a), grid.cell(*b)
    found = shortest_path(cell_prices(grid, start, blocked), start, {goal})
    return None if found is None else [(row, column) for row, column in found.tolist()]


def two_rooms(gap_m: float) -> GridMap:
    """Two rooms with an opening of that width between them, around y = 3."""
    low, high = 3.0 - gap_m / 2, 3.0 + gap_m / 2
    return drawn(
        [(1.0, 1.0, 9.0, 5.0)],
        [(5.0, 1.0, 5.1, low), (5.0, high, 5.1, 5.0), (1.0, 0.9, 9.0, 1.0), (1.0, 5.0, 9.0, 5.1)],
    )


@pytest.mark.requirement("PLN_MR_03")
def test_a_way_leads_through_the_opening_and_not_through_the_wall() -> None:
    grid = two_rooms(1.6)
    cells = path(grid, (2.0, 1.6), (8.0, 1.6))
    assert cells is not None
    assert cells[0] == grid.cell(2.0, 1.6)
    assert cells[-1] == grid.cell(8.0, 1.6)
    assert all(grid.standable(cell) for cell in cells)
    crossing = [grid.centre(c)[1] for c in cells if abs(grid.centre(c)[0] - 5.05) < 0.1]
    assert crossing == pytest.approx([3.0] * len(crossing), abs=0.3)


def test_a_way_along_a_hall_keeps_to_its_middle() -> None:
    grid = hall(width_m=2.0)
    cells = path(grid, (1.6, 1.5), (8.4, 1.5))
    assert cells is not None
    middle = [grid.centre(c)[1] for c in cells if 3.5 < grid.centre(c)[0] < 6.5]
    assert middle == pytest.approx([2.0] * len(middle), abs=0.25)


@pytest.mark.requirement("PLN_MR_03")
def test_no_way_leads_through_a_gap_narrower_than_the_footprint() -> None:
    gap_m = 0.4
    assert gap_m < 2 * FOOTPRINT_RADIUS_M
    assert path(two_rooms(gap_m), (2.0, 3.0), (8.0, 3.0)) is None


def staggered(opening_m: float = 0.0) -> GridMap:
    """Two rooms whose walls leave a gap across a corner that the footprint just fits, and maybe an opening below."""
    return drawn(
        [(1.0, 1.0, 9.0, 5.0)],
        [
            (5.0, 1.0 + opening_m, 5.1, 3.0),
            (5.4, 3.3, 5.5, 5.0),
            (1.0, 0.9, 9.0, 1.0),
            (1.0, 5.0, 9.0, 5.1),
        ],
    )


def tight_cells(grid: GridMap, cells: list[Cell]) -> list[Cell]:
    return [cell for cell in cells if not grid.standable(cell)]


@pytest.mark.requirement("PLN_MR_03")
def test_a_gap_that_the_footprint_just_fits_is_taken_where_no_other_way_leads() -> None:
    grid = staggered()
    cells = path(grid, (2.0, 3.5), (8.0, 2.8))
    assert cells is not None
    tight = tight_cells(grid, cells)
    assert tight
    assert min(grid.clearance_m(cell) for cell in tight) >= TIGHT_CLEARANCE_M
    prices = cell_prices(grid, cells[0])
    assert [prices.of(cell) for cell in tight] == pytest.approx([TIGHT_PRICE * grid.cell_m] * len(tight))


@pytest.mark.requirement("PLN_MR_03")
def test_a_wide_opening_a_little_out_of_the_way_is_taken_before_a_tight_gap() -> None:
    grid = staggered(opening_m=1.0)
    cells = path(grid, (2.0, 3.5), (8.0, 2.8))
    assert cells is not None
    assert not tight_cells(grid, cells)


def test_blocked_cells_are_gone_round_or_leave_no_way() -> None:
    grid = hall(width_m=3.0)
    blocked = np.zeros(grid.cells.shape, dtype=bool)
    rows, columns = np.indices(grid.cells.shape)
    blocked[np.hypot(columns - 50, rows - 25) < 6] = True
    cells = path(grid, (2.0, 2.5), (8.0, 2.5), blocked)
    assert cells is not None
    assert not any(blocked[c] for c in cells)
    blocked[:, 50] = True
    assert path(grid, (2.0, 2.5), (8.0, 2.5), blocked) is None


def test_a_robot_that_stands_too_near_to_a_wall_finds_its_way_out() -> None:
    grid = hall()
    assert not grid.standable(grid.cell(4.0, 1.15))
    assert path(grid, (4.0, 1.15), (8.0, 2.0)) is not None


def test_a_robot_inside_of_what_blocks_finds_its_way_out() -> None:
    grid = hall(width_m=3.0)
    blocked = np.zeros(grid.cells.shape, dtype=bool)
    row, column = grid.cell(3.0, 2.5)
    blocked[row - 3 : row + 4, column - 3 : column + 4] = True
    blocked[row, column] = True
    cells = path(grid, (3.0, 2.5), (8.0, 2.5), blocked)
    assert cells is None or not any(blocked[c] for c in cells[5:])


def test_in_the_middle_of_a_hall_a_way_costs_its_length() -> None:
    grid = hall(width_m=3.0)
    cells = path(grid, (2.4, 2.5), (7.6, 2.5))
    assert cells is not None
    prices = cell_prices(grid, cells[0])
    assert sum(prices.of(cell) for cell in cells[1:]) == pytest.approx(5.2, rel=0.1)


def test_the_nearest_of_several_goals_is_taken() -> None:
    grid = hall()
    start, goals = grid.cell(5.0, 2.0), {grid.cell(2.0, 2.0), grid.cell(6.0, 2.0)}
    found = shortest_path(cell_prices(grid, start), start, goals)
    assert found is not None
    assert tuple(found[-1].tolist()) == grid.cell(6.0, 2.0)


def test_from_outside_of_the_grid_there_is_no_way() -> None:
    grid = hall()
    prices = cell_prices(grid, grid.cell(2.0, 2.0))
    assert shortest_path(prices, grid.cell(-3.0, 2.0), {grid.cell(2.0, 2.0)}) is None


def test_a_robot_outside_of_the_grid_that_it_last_received_gets_the_prices_of_the_rest() -> None:
    grid = hall()
    blocked = np.zeros(grid.cells.shape, dtype=bool)
    blocked[20, 20] = True
    before, behind = (cell_prices(grid, grid.cell(x_m, 2.0), blocked) for x_m in (50.0, -50.0))
    assert (before.kinds == behind.kinds).all()
    assert before.by_kind == behind.by_kind


@pytest.mark.requirement("PLN_MR_03")
def test_string_pulling_leaves_few_legs_and_keeps_the_clearance() -> None:
    grid = two_rooms(1.6)
    cells = path(grid, (2.0, 1.6), (8.0, 1.6))
    assert cells is not None
    waypoints = pull_string(grid, np.array(cells), cell_prices(grid, cells[0]))
    assert waypoints[0] == grid.centre(cells[0])
    assert waypoints[-1] == grid.centre(cells[-1])
    assert len(waypoints) <= 8
    for a, b in pairwise(waypoints):
        assert straight_is_clear(grid, a, b, FOOTPRINT_RADIUS_M)
    length_m = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(waypoints))
    assert 6.0 < length_m < 8.0


def test_a_way_of_one_cell_is_its_own_end() -> None:
    grid = hall()
    cell = grid.cell(4.0, 2.0)
    assert pull_string(grid, np.array([cell]), cell_prices(grid, cell)) == [grid.centre(cell)]


def test_a_door_is_driven_to_on_the_side_that_paths_lead_to_and_as_near_as_the_footprint_fits() -> None:
    # Two halls along x, a wall of one cell between them
    halls = drawn([(1.0, 1.0, 9.0, 2.5), (1.0, 2.6, 9.0, 4.1)], [(1.0, 2.5, 9.0, 2.6)], (10.0, 5.0))
    grids = Grids()
    grids.put(1, halls)
    for y_m, side in ((2.0, -1.0), (3.2, 1.0)):
        path = FindPathBefore(1, Pose2(2.0, y_m, 0.0), (6.0, 2.55), ()).answer(grids)
        assert path is not None
        assert abs(path[-1][0] - 6.0) < 0.11
        assert -0.01 < side * (path[-1][1] - 2.55) - STAND_CLEARANCE_M < 0.11
    assert FindPathBefore(1, Pose2(2.0, 2.0, 0.0), (20.0, 20.0), ()).answer(grids) is None


def test_cells_count_as_reachable_where_a_path_leads_to_them() -> None:
    chance = np.random.default_rng(3)
    for _ in range(20):
        coarse = chance.choice(np.array([UNKNOWN, FREE, FREE, WALL], np.uint8), (6, 7))
        grid = GridMap(np.kron(coarse, np.ones((9, 9), np.uint8)), 0.0, 0.0, 0.1)
        start = (31, 31)
        prices = cell_prices(grid, start)
        found = reachable(prices, start)
        for cell in [tuple(chance.integers(0, 54, 2).tolist()) for _ in range(30)]:
            if prices.of(start):
                assert found[cell] == (bool(prices.of(cell)) and shortest_path(prices, start, {cell}) is not None)


def test_a_robot_on_a_cell_that_an_echo_made_a_wall_of_reaches_the_floor_around_it() -> None:
    grid = hall()
    grid.cells[grid.cell(4.0, 2.0)] = WALL
    assert reachable(cell_prices(grid, grid.cell(4.0, 2.0)), grid.cell(4.0, 2.0))[grid.cell(7.0, 2.0)]
