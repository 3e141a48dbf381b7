"""Two runs over each other: how they lie, which walls only one has, and what the other one cannot know."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from common.geometry import Points, Pose2
from offboard.evaluate.map_difference import Mask, map_difference, seen_of
from offboard.export.occupancy_image import OccupancyImage


def line(x0: float, y0: float, x1: float, y1: float) -> Points:
    """A wall at the density of the specification."""
    count = round(np.hypot(x1 - x0, y1 - y0) * 10) + 1
    return np.column_stack([np.linspace(x0, x1, count), np.linspace(y0, y1, count)])


HALL = np.concatenate([line(0.0, -1.0, 20.0, -1.0), line(0.0, 1.0, 9.0, 1.0), line(11.0, 1.0, 20.0, 1.0)])
SIDE = np.concatenate([line(9.0, 1.0, 9.0, 6.0), line(11.0, 1.0, 11.0, 6.0), line(20.0, -1.0, 20.0, 1.0)])
FLOOR = np.concatenate([HALL, SIDE])
SHELF = line(4.0, 0.4, 6.0, 0.4)  # in the middle of the hall, of one run only


def everything(places_m: Points) -> Mask:
    return np.ones(len(places_m), bool)


def test_a_wall_that_only_one_run_has_is_found_though_the_other_began_a_little_turned() -> None:
    began = Pose2(0.25, -0.15, radians(2.0))
    there = began.inverse().transform(FLOOR)
    found = map_difference(np.concatenate([FLOOR, SHELF]), there, everything, everything)
    assert (found.placed.x_m, found.placed.y_m) == pytest.approx((0.25, -0.15), abs=0.05)
    assert found.placed.heading_rad == pytest.approx(radians(2.0), abs=radians(0.2))
    assert len(found.only_there_m) == 0
    assert np.abs(found.only_here_m - (5.0, 0.4)).max(axis=0) == pytest.approx((1.0, 0.0), abs=0.2)
    assert "moved 0.29 m, turned 2.0°" in found.as_text()


def test_what_the_other_run_has_not_seen_is_no_difference() -> None:
    found = map_difference(FLOOR, HALL, everything, lambda places_m: (places_m[:, 1] < 1.0) & (places_m[:, 0] < 19.5))
    assert len(found.only_here_m) == 0
    assert len(found.unseen_m) > 70
    assert found.agreement > 0.95


def test_a_run_without_walls_differs_in_nothing() -> None:
    found = map_difference(FLOOR, np.empty((0, 2)), everything, everything)
    assert len(found.unseen_m) == len(FLOOR)
    assert found.agreement == 0.0


def test_a_run_has_seen_its_known_cells_and_those_beside_them() -> None:
    cells = np.full((20, 40), 205, np.uint8)
    cells[10, 20] = 254  # row 0 is the top one: y 0.45 to 0.5
    seen = seen_of(OccupancyImage(cells, 1.0, 0.0))
    places = np.array([[2.02, 0.47], [2.07, 0.52], [2.12, 0.47], [1.5, 0.2], [-5.0, 0.47]])
    assert seen(places).tolist() == [True, True, False, False, False]
