"""The scripted path: through every hall, in the middle, and back."""

from __future__ import annotations

import numpy as np
import pytest

from common.constants import FOOTPRINT_RADIUS_M
from common.geometry import FloatArray
from offboard.simulator.building.floor import Floor, load_floor, wall_segments
from offboard.simulator.building.polygons import distances_m
from offboard.simulator.run.options import floor_path, own_floors
from offboard.simulator.run.route import Middles


def path_of(floor: Floor) -> FloatArray:
    start = floor.starts[0]
    return Middles(floor).path(np.array([start.x_m, start.y_m]))


@pytest.mark.parametrize("name", own_floors())
def test_the_path_keeps_off_the_walls_and_comes_back(name: str) -> None:
    floor = load_floor(floor_path(name))
    path = path_of(floor)
    walls = wall_segments(floor)
    assert min(distances_m(walls, x, y).min() for x, y in path) > FOOTPRINT_RADIUS_M + 0.05
    assert np.hypot(*(path[0] - path[-1])) < 0.15
    assert np.hypot(*np.diff(path, axis=0).T).max() < 0.15


def test_the_path_goes_round_the_island_and_into_every_hall() -> None:
    floor = load_floor(floor_path("loop"))
    path = path_of(floor)
    (x0, y0), (x1, y1) = np.array(floor.holes[0]).min(axis=0), np.array(floor.holes[0]).max(axis=0)
    for x, y in ((x0, (y0 + y1) / 2), (x1, (y0 + y1) / 2), ((x0 + x1) / 2, y0), ((x0 + x1) / 2, y1)):
        assert np.hypot(*(path - [x, y]).T).min() < 2.0
