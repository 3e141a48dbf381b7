"""The scripted drives: through every hall in the middle, or along every wall with the camera on it; and back."""

from __future__ import annotations

from functools import cache
from math import cos, sin

import numpy as np
import pytest

from common.constants import CAMERA_FIELD_OF_VIEW_RAD, FOOTPRINT_RADIUS_M
from common.geometry import FloatArray, wrap_angles
from offboard.simulator.building.floor import Floor, load_floor, wall_segments
from offboard.simulator.building.polygons import distances_m
from offboard.simulator.run.free_floor import FreeFloor
from offboard.simulator.run.options import floor_path, own_floors
from offboard.simulator.run.route import CENTRELINES, ROUTES, WALLS, planned_route
from offboard.simulator.run.wall_route import Looks


@cache
def route_of(floor: Floor, name: str) -> tuple[FloatArray, Looks]:
    start = floor.starts[0]
    return planned_route(name, floor, free_floor(floor), np.array([start.x_m, start.y_m]))


@cache
def free_floor(floor: Floor) -> FreeFloor:
    return FreeFloor(floor)


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("name", own_floors())
def test_the_path_keeps_off_the_walls_and_comes_back(name: str, route: str) -> None:
    floor = load_floor(floor_path(name))
    path, _ = route_of(floor, route)
    walls = wall_segments(floor)
    assert min(distances_m(walls, x, y).min() for x, y in path) > FOOTPRINT_RADIUS_M + 0.05
    assert np.hypot(*(path[0] - path[-1])) < 0.15
    assert np.hypot(*np.diff(path, axis=0).T).max() < 0.3


def test_the_path_goes_round_the_island_and_into_every_hall() -> None:
    floor = load_floor(floor_path("loop"))
    path, _ = route_of(floor, CENTRELINES)
    (x0, y0), (x1, y1) = np.array(floor.holes[0]).min(axis=0), np.array(floor.holes[0]).max(axis=0)
    for x, y in ((x0, (y0 + y1) / 2), (x1, (y0 + y1) / 2), ((x0 + x1) / 2, y0), ((x0 + x1) / 2, y1)):
        assert np.hypot(*(path - [x, y]).T).min() < 2.0


@pytest.mark.parametrize("name", own_floors())
def test_every_door_passes_square_before_the_camera(name: str) -> None:
    floor = load_floor(floor_path(name))
    path, looks = route_of(floor, WALLS)
    steps = np.diff(path, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    for door in floor.doors:
        square = np.abs(wrap_angles(headings - (door.normal_rad - np.pi / 2))) < 0.1
        dx, dy = (path[:-1] - [door.plate.x_m, door.plate.y_m]).T
        out_m = dx * cos(door.normal_rad) + dy * sin(door.normal_rad)
        aside_m = -dx * sin(door.normal_rad) + dy * cos(door.normal_rad)
        in_view = np.abs(aside_m) < out_m * np.tan(CAMERA_FIELD_OF_VIEW_RAD / 2)
        assert (square & in_view & (out_m > 0.3) & (out_m < 2.3)).sum() >= 4, door.number
    assert looks
