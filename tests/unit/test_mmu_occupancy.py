"""The occupancy grid: wall, free, unknown, and what a ray may not free."""

from __future__ import annotations

import tracemalloc
from math import inf, pi

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.grid_cells import FREE, UNKNOWN, WALL
from onboard.mmu.map.occupancy import CELL_M, OccupancyGrid

START = np.array([[0.05, 0.05]])


def at(grid: OccupancyGrid, x_m: float, y_m: float) -> int:
    origin_x_m, origin_y_m = grid.origin_m
    return int(grid.cells()[int((y_m - origin_y_m) // CELL_M), int((x_m - origin_x_m) // CELL_M)])


def with_wall(free_m: float) -> OccupancyGrid:
    """An echo per cell on a wall across the x axis at 2.05 m, and a ray along that axis."""
    y = np.arange(-0.95, 1.0, CELL_M)
    grid = OccupancyGrid()
    grid.add_walls(np.stack([np.full_like(y, 2.05), y], axis=1), np.full_like(y, pi))
    grid.add_rays(START, [0.0], [free_m])
    return grid


def test_nothing_is_known_at_first() -> None:
    assert (OccupancyGrid().cells() == UNKNOWN).all()


def test_a_ray_frees_up_to_its_echo_and_echoes_make_a_wall() -> None:
    grid = with_wall(2.0)
    assert at(grid, 1.0, 0.05) == FREE
    assert at(grid, 2.05, 0.05) == WALL
    assert at(grid, 2.5, 0.05) == UNKNOWN
    assert at(grid, -0.5, 0.05) == UNKNOWN
    assert at(grid, 1.0, 1.0) == UNKNOWN


@pytest.mark.parametrize("normal_rad", [0.0, 0.4, pi / 4, 1.2, pi / 2])
def test_one_stray_echo_is_no_wall(normal_rad: float) -> None:
    grid = OccupancyGrid()
    grid.add_walls(np.array([[2.05, 0.05]]), np.array([normal_rad]))
    assert (grid.cells() != WALL).all()


def test_a_ray_frees_nothing_behind_a_known_wall() -> None:
    grid = with_wall(4.0)
    assert at(grid, 1.8, 0.05) == FREE
    assert at(grid, 2.05, 0.05) == WALL
    assert at(grid, 3.0, 0.05) == UNKNOWN


def test_what_lies_far_off_takes_no_memory() -> None:
    """A pose that is off by kilometres would have filled it."""
    grid, far = with_wall(2.0), np.array([[1e6, 0.05], [-1e9, 1e12]])
    shape = grid.shape
    tracemalloc.start()
    grid.add_walls(np.concatenate([far, [[2.05, 0.05]]]), np.zeros(3))
    grid.add_rays(np.concatenate([START, far]), [pi / 2, 0.0, 0.0], [1.0, 2.0, 2.0])
    grid.add_footprint(far)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert grid.shape == shape
    assert peak_bytes < 1e6
    assert at(grid, 0.05, 0.6) == FREE
    assert at(grid, 2.05, 0.05) == WALL


def test_silence_frees_the_near_floor_only() -> None:
    grid = OccupancyGrid()
    grid.add_rays(START, [0.0], [inf])
    assert at(grid, 0.8, 0.05) == FREE
    assert at(grid, 1.5, 0.05) == UNKNOWN


@pytest.mark.parametrize("free_m", [0.0, 0.05, 0.15])
def test_a_range_at_the_minimum_frees_nothing_far(free_m: float) -> None:
    grid = OccupancyGrid()
    grid.add_rays(START, [0.0], [free_m])
    assert at(grid, 0.3, 0.05) == UNKNOWN


def test_where_the_robot_stood_is_no_wall() -> None:
    grid = OccupancyGrid()
    grid.add_walls(np.repeat(START, 5, axis=0), np.zeros(5))
    grid.add_footprint(START)
    for angle in np.arange(0.0, 2 * pi, pi / 4):
        reach_m = FOOTPRINT_RADIUS_M - CELL_M / 2
        assert at(grid, 0.05 + reach_m * float(np.cos(angle)), 0.05 + reach_m * float(np.sin(angle))) == FREE


def test_what_was_driven_over_stays_open_whatever_echoes_say_later() -> None:
    """Corner echoes smear into the mouth of a narrow hall: the robot must find back through it."""
    grid = OccupancyGrid()
    grid.add_footprint(np.stack([np.arange(0.05, 2.0, CELL_M), np.full(20, 0.05)], axis=1))
    grid.add_walls(np.repeat([[1.05, 0.05], [1.05, 0.45]], 5, axis=0), np.full(10, pi / 2))
    grid.add_walls(np.array([[60.05, 3.05]] * 2), np.zeros(2))  # it grows
    grid.add_walls(np.repeat([[0.55, 0.05]], 5, axis=0), np.zeros(5))
    assert at(grid, 1.05, 0.05) == at(grid, 0.55, 0.05) == at(grid, 0.55, 0.15) == FREE
    assert at(grid, 1.05, 0.45) == WALL


@pytest.mark.parametrize("place", [(60.0, 3.0), (-60.0, 3.0), (3.0, 60.0), (-40.0, -40.0)])
def test_the_grid_grows_and_keeps_what_it_knew(place: tuple[float, float]) -> None:
    grid = with_wall(2.0)
    grid.add_walls(np.array([place, place]) + 0.05, np.zeros(2))
    assert at(grid, place[0] + 0.05, place[1] + 0.05) == WALL
    assert at(grid, 2.05, 0.05) == WALL
    assert at(grid, 1.0, 0.05) == FREE


def test_nothing_to_add_changes_nothing() -> None:
    grid = OccupancyGrid()
    none = np.zeros((0, 2))
    grid.add_walls(none, np.zeros(0))
    grid.add_footprint(none)
    grid.add_rays(none, [], [])
    assert (grid.cells() == UNKNOWN).all()


def test_many_rays_are_drawn_in_little_memory() -> None:
    """A corrected past draws the whole run anew; the board has half a gigabyte for everything."""
    random = np.random.default_rng(1)
    starts = random.uniform(-8.0, 8.0, (4000, 2))  # of two minutes
    grid = OccupancyGrid()
    tracemalloc.start()
    try:
        grid.add_rays(starts, random.uniform(-3.0, 3.0, 4000), random.uniform(0.5, 6.0, 4000))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6
