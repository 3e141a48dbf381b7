"""Which walls the camera has seen, on drawn halls."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose2, wrap_angle
from common.grid_cells import WALL
from onboard.planner.exploration.wall_imaging import SeenWalls, WallImaging, beginning, box_sum, wall_normals
from onboard.planner.exploration.wall_imaging import spots as spots_of
from onboard.planner.grid.grid_map import GridMap
from tests.unit.test_planner_grid_map import drawn, hall

LOWER_M, UPPER_M = 0.95, 3.05  # middles of the two long walls of `hall`


def driven(grid: GridMap, x0_m: float, x1_m: float, heading_rad: float) -> WallImaging:
    """Along the middle of the hall, in steps of a tick."""
    imaging = WallImaging()
    for x_m in np.linspace(x0_m, x1_m, round(abs(x1_m - x0_m) / 0.02)).tolist():
        imaging.look(grid, Pose2(x_m, 2.0, heading_rad))
    return imaging


def unseen_along(imaging: WallImaging, grid: GridMap, y_m: float) -> list[float]:
    cells = np.argwhere(imaging.unseen(grid))
    centres = grid.centres(cells)
    return sorted(centres[np.abs(centres[:, 1] - y_m) < 0.06][:, 0].tolist())


def test_driving_one_way_shows_the_wall_on_the_right_only() -> None:
    grid = hall()
    imaging = driven(grid, 1.5, 8.5, 0.0)
    assert unseen_along(imaging, grid, LOWER_M) == []
    assert len(unseen_along(imaging, grid, UPPER_M)) > 60


def test_a_wall_that_comes_onto_the_grid_after_it_was_passed_counts_as_seen() -> None:
    blank, grid = drawn([(1.0, 1.0, 9.0, 3.0)], [], (10.0, 4.0)), hall()
    imaging = WallImaging()
    for x_m in np.linspace(1.5, 8.5, 350).tolist():
        imaging.look(blank if x_m < 7.5 else grid, Pose2(x_m, 2.0, 0.0))
    assert min(unseen_along(imaging, grid, LOWER_M), default=9.0) < 5.5  # what was too long ago
    assert not [x for x in unseen_along(imaging, grid, LOWER_M) if 6.5 < x < 8.0]


def test_nothing_is_seen_while_the_robot_turns() -> None:
    grid, imaging = hall(), WallImaging()
    for turned_rad in np.arange(0.0, 2 * pi, radians(5.0)).tolist():
        imaging.look(grid, Pose2(5.0, 2.0, wrap_angle(turned_rad)))
    assert len(unseen_along(imaging, grid, LOWER_M)) > 60


def test_a_wall_behind_a_wall_is_not_seen() -> None:
    behind = (2.0, 0.4, 8.0, 0.5)
    grid = drawn([(1.0, 1.0, 9.0, 3.0)], [(1.0, 0.9, 9.0, 1.0), behind], (10.0, 4.0))
    imaging = driven(grid, 1.5, 8.5, 0.0)
    assert unseen_along(imaging, grid, LOWER_M) == []
    assert len(unseen_along(imaging, grid, 0.45)) > 50


def test_spots_face_along_the_unseen_wall_and_have_it_on_the_right() -> None:
    grid = hall()
    imaging = driven(grid, 1.5, 8.5, 0.0)
    spots = spots_of(grid, imaging.imaged, Pose2(5.0, 2.0, 0.0))
    along = {cell: rad for cell, rad in spots.items() if abs(abs(rad) - pi) < radians(20.0)}
    assert len(along) > 40
    for cell in along:
        assert grid.standable(cell)
        assert grid.centre(cell)[1] == pytest.approx(UPPER_M - 1.5, abs=0.35)


def test_a_stretch_is_begun_at_its_rear_end() -> None:
    grid = hall()
    spots = spots_of(grid, driven(grid, 1.5, 8.5, 0.0).imaged, Pose2(8.5, 2.0, 0.0))
    middle = min(spots, key=lambda cell: abs(grid.centre(cell)[0] - 5.0) + abs(abs(spots[cell]) - pi))
    assert grid.centre(beginning(spots, grid, middle))[0] > 8.0


def test_it_is_worth_going_on_as_long_as_an_unseen_wall_is_on_the_right() -> None:
    grid = hall()
    imaging = driven(grid, 1.5, 5.0, 0.0)
    assert imaging.worth_going_on(grid, Pose2(5.0, 2.0, 0.0), 0.0)
    assert not imaging.worth_going_on(grid, Pose2(2.0, 2.0, 0.0), 0.0)
    assert imaging.worth_going_on(grid, Pose2(2.0, 2.0, pi), pi)


def test_a_turn_on_the_spot_shows_the_wall_ahead_on_the_right() -> None:
    grid = hall()
    imaging = driven(grid, 1.5, 7.5, 0.0)
    assert imaging.shows_new(grid, Pose2(7.5, 2.0, pi / 2))
    assert not imaging.shows_new(grid, Pose2(7.0, 2.0, 0.0))
    assert not imaging.shows_new(grid, Pose2(5.0, 2.0, pi / 2))


def test_what_was_settled_is_not_asked_for_again() -> None:
    grid, imaging = hall(), WallImaging()
    for x_m in np.arange(1.2, 9.0, 0.3).tolist():
        imaging.settle(grid, Pose2(x_m, 2.0, 0.0))
    assert unseen_along(imaging, grid, LOWER_M) == []


def test_what_was_seen_stays_seen_when_the_grid_grows() -> None:
    grid = hall()
    imaging = driven(grid, 1.5, 8.5, 0.0)
    grown = GridMap(np.pad(grid.cells, 25), grid.origin_x_m - 2.5, grid.origin_y_m - 2.5, grid.cell_m)
    assert unseen_along(imaging, grown, LOWER_M) == []


def test_seen_cells_are_found_again_on_any_part_of_the_map() -> None:
    whole = drawn([], size_m=(60.0, 40.0), origin_m=(-30.0, -20.0))
    chance, seen, expected = np.random.default_rng(4), SeenWalls(), np.zeros(whole.cells.shape, dtype=bool)
    for _ in range(30):
        r, c = (int(chance.integers(0, side - 50)) for side in whole.cells.shape)
        part = whole.part((slice(r, r + 50), slice(c, c + 50)))
        cells = chance.integers(0, 50, (5, 2))
        seen.add(part, cells)
        expected[tuple((cells + [r, c]).T)] = True
        assert (seen.on(whole) == expected).all()
        assert (seen.on(part) == expected[r : r + 50, c : c + 50]).all()
    kept = seen.copy()
    seen.add(whole, np.array([[0, 0]]))
    assert (kept.on(whole) == expected).all()


@given(st.floats(0.0, pi, exclude_max=True))
def test_normals_stand_square_on_walls_of_any_direction(direction_rad: float) -> None:
    cells = np.zeros((60, 60), np.uint8)
    for along in np.arange(-2.5, 2.5, 0.02):
        cells[int((3.0 + along * np.sin(direction_rad)) / 0.1), int((3.0 + along * np.cos(direction_rad)) / 0.1)] = WALL
    normals = wall_normals(GridMap(cells, 0.0, 0.0, 0.1))
    found = normals[15:45, 15:45]
    off = (found[~np.isnan(found)] - direction_rad - pi / 2 + pi / 2) % pi - pi / 2
    assert len(off) > 10
    assert np.abs(off).max() < radians(15.0)


def test_box_sum_is_the_sum_over_the_neighbourhood() -> None:
    values = np.random.default_rng(1).random((7, 9))
    padded = np.pad(values, 2)
    expected = [[padded[r : r + 5, c : c + 5].sum() for c in range(9)] for r in range(7)]
    assert box_sum(values, 2) == pytest.approx(np.array(expected))
