"""The grid as the Planner reads it; draws the small floors that the Planner's other tests use."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.grid_cells import FREE, UNKNOWN, WALL
from common.messages.mapping import GridUpdate
from onboard.planner.grid.grid_map import GridMap, close_slivers
from onboard.planner.grid.grid_reading import TILE_CELLS, GridError, GridReader

CELL_M = 0.1
Box = tuple[float, float, float, float]  # x0, y0, x1, y1 in metres


def drawn(
    free: list[Box],
    walls: list[Box] | None = None,
    size_m: tuple[float, float] = (10.0, 6.0),
    origin_m: tuple[float, float] = (0.0, 0.0),
) -> GridMap:
    """A grid with these boxes free and then these ones wall; the rest is unknown."""
    cells = np.full((round(size_m[1] / CELL_M), round(size_m[0] / CELL_M)), UNKNOWN, np.uint8)
    for boxes, value in ((free, FREE), (walls or [], WALL)):
        for x0, y0, x1, y1 in boxes:
            rows = slice(round((y0 - origin_m[1]) / CELL_M), round((y1 - origin_m[1]) / CELL_M))
            cells[rows, round((x0 - origin_m[0]) / CELL_M) : round((x1 - origin_m[0]) / CELL_M)] = value
    return GridMap(cells, *origin_m, CELL_M)


def hall(length_m: float = 8.0, width_m: float = 2.0, closed: bool = True) -> GridMap:
    """A hall along x from (1, 1), its walls one cell thick; not `closed` = nobody has seen its far end."""
    x1, y1 = 1.0 + length_m, 1.0 + width_m
    walls = [(1.0, 0.9, x1, 1.0), (1.0, y1, x1, y1 + 0.1), (0.9, 0.9, 1.0, y1 + 0.1)]
    if closed:
        walls.append((x1, 0.9, x1 + 0.1, y1 + 0.1))
    return drawn([(1.0, 1.0, x1, y1)], walls, (x1 + 1.0, y1 + 1.0))


def update_of(grid: GridMap, revision: int = 1, margin: int = 0, t_s: float = 0.0) -> GridUpdate:
    """The message with this grid, with a margin of unknown cells."""
    cells = np.pad(grid.cells, margin)
    return GridUpdate(
        t_s,
        revision,
        grid.origin_x_m - margin * CELL_M,
        grid.origin_y_m - margin * CELL_M,
        CELL_M,
        *cells.shape,
        zlib.compress(cells.tobytes()),
    )


def test_message_is_read_and_cut_to_what_is_known() -> None:
    grid = GridReader().read(update_of(hall(), margin=50))
    assert grid.cells.shape[0] < 50
    assert grid.cells[grid.cell(3.0, 2.0)] == FREE
    assert grid.cells[grid.cell(3.0, 0.95)] == WALL
    assert grid.centre(grid.cell(3.05, 2.05)) == pytest.approx((3.05, 2.05))


@pytest.mark.parametrize(
    "broken",
    [
        {"rows": update_of(hall()).rows + 1},
        {"cells_zlib": update_of(hall()).cells_zlib[:-8]},
        {"cells_zlib": b"no cells"},
        {"cells_zlib": zlib.compress(bytes(50_000_000))},
    ],
    ids=["a row too many", "cut off", "not packed", "a bomb"],
)
def test_a_message_that_is_no_grid_is_refused(broken: dict[str, Any]) -> None:
    with pytest.raises(GridError):
        GridReader().read(replace(update_of(hall()), **broken))


def test_a_large_grid_is_read_in_tiles_and_as_if_it_were_one() -> None:
    chance = np.random.default_rng(1)
    coarse = chance.choice(np.array([UNKNOWN, FREE, FREE, WALL], np.uint8), (250, 180))
    cells = np.kron(coarse, np.ones((6, 7), np.uint8))
    cells[chance.random(cells.shape) < 0.1] = UNKNOWN
    cells[[0, -1]] = FREE
    grid = GridReader().read(update_of(GridMap(cells, -20.0, 5.0, CELL_M)))
    whole = GridMap(close_slivers(cells), -20.0, 5.0, CELL_M)
    assert min(grid.cells.shape) > 2 * TILE_CELLS
    assert (grid.cells == whole.cells).all()
    assert (grid.wall_distance2 == whole.wall_distance2).all()
    assert (grid.frontier == whole.frontier).all()


def test_a_grid_that_changes_here_and_there_and_grows_is_read_as_if_it_were_the_first() -> None:
    chance = np.random.default_rng(2)
    cells = np.kron(chance.choice(np.array([UNKNOWN, FREE, WALL], np.uint8), (30, 20)), np.ones((5, 5), np.uint8))
    origin_m, reader = (3.0, -7.0), GridReader()
    for turn in range(12):
        row, column = (int(chance.integers(0, side - 8)) for side in cells.shape)
        cells[row : row + 8, column : column + 8] = chance.choice([UNKNOWN, FREE, WALL], (8, 8))
        if turn % 3 == 1:  # beyond where it began, and less at its end
            cells = np.pad(cells, ((9, 0), (0, 12)), constant_values=FREE)[:, 2:]
            origin_m = origin_m[0] + 2 * CELL_M, origin_m[1] - 9 * CELL_M
        update = update_of(GridMap(cells.copy(), *origin_m, CELL_M), margin=6)
        grid, first = reader.read(update), GridReader().read(update)
        assert grid.centre((0, 0)) == pytest.approx(first.centre((0, 0)))
        assert (grid.cells == first.cells).all()
        assert (grid.wall_distance2 == first.wall_distance2).all()
        assert (grid.frontier == first.frontier).all()


def test_a_grid_with_nothing_known_has_no_frontier_and_no_area() -> None:
    grid = GridReader().read(update_of(drawn([])))
    assert not grid.frontier.any()
    assert grid.area_m2 == 0.0


def test_clearance_is_the_distance_to_the_nearest_wall_cell() -> None:
    grid = hall(width_m=2.0)
    assert grid.clearance_m(grid.cell(5.0, 1.95)) == pytest.approx(1.0, abs=0.1)
    assert grid.clearance_m(grid.cell(5.0, 1.25)) == pytest.approx(0.3, abs=0.1)
    assert grid.clearance_m(grid.cell(8.95, 2.0)) == pytest.approx(0.1, abs=0.01)


@pytest.mark.requirement("PLN_MR_03")
def test_the_footprint_stands_nowhere_that_it_would_touch() -> None:
    grid = hall()
    standable = np.argwhere(grid.standable())
    walls = grid.centres(np.argwhere(grid.cells == WALL))
    for place in grid.centres(standable)[::7]:
        to_face_m = np.hypot(*(walls - place).T).min() - CELL_M / 2
        assert to_face_m > FOOTPRINT_RADIUS_M


def test_end_that_nobody_has_seen_is_frontier_and_a_closed_one_is_not() -> None:
    assert not hall(closed=True).frontier.any()
    grid = hall(closed=False)
    frontier = grid.centres(np.argwhere(grid.frontier))
    assert len(frontier) >= 5
    assert frontier[:, 0] == pytest.approx([8.95] * len(frontier))


def test_sight_ends_at_a_wall() -> None:
    grid = drawn([(1.0, 1.0, 9.0, 3.0)], [(5.0, 1.0, 5.1, 2.0)])
    assert not grid.sees((3.0, 1.5), (7.0, 1.5))
    assert grid.sees((3.0, 2.5), (7.0, 2.5))


def test_many_sight_lines_are_looked_along_as_one_by_one() -> None:
    grid, chance = drawn([(1.0, 1.0, 9.0, 5.0)], [(5.0, 1.0, 5.1, 2.0), (3.0, 3.0, 3.1, 5.0)]), np.random.default_rng(2)
    a, b = chance.uniform(-1.0, 10.0, (2, 300, 2))
    one_by_one = [grid.sees(tuple(start), tuple(end)) for start, end in zip(a.tolist(), b.tolist(), strict=True)]
    assert 30 < sum(one_by_one) < 270
    assert np.mean(grid.sees_each(a, b) == one_by_one) > 0.99
    from_one = [grid.sees(tuple(a[0].tolist()), tuple(end)) for end in b.tolist()]
    assert np.mean(grid.sees_each(a[0], b) == from_one) > 0.99
    assert grid.sees_each(a[0], b[:0]).shape == (0,)


def test_the_footprint_stands_at_many_places_where_it_stands_at_each() -> None:
    grid = hall()
    places = np.random.default_rng(3).uniform(-1.0, 11.0, (500, 2))
    assert grid.stands_each(places).tolist() == [grid.stands(x_m, y_m) for x_m, y_m in places.tolist()]


def test_lines_that_leave_the_grid_stay_inside_the_array() -> None:
    grid = hall()
    rows, columns = grid.line((-5.0, -5.0), (50.0, 50.0))
    assert grid.cells[rows, columns].shape == rows.shape


def test_a_line_of_any_length_is_looked_along_at_a_bounded_cost() -> None:
    grid = replace(hall(), cell_m=0.01)
    rows, columns = grid.line((-1e5, -1e5), (1e5, 1e5))
    assert len(rows) == len(columns) < 30_000
