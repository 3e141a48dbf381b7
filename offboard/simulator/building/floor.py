"""A floor file -> `Floor`: the building that the simulated world, its sonars and its camera use.

Reads JSON in the format of the project's own `floors/*.json`: lengths in metres, angles in degrees. `halls` and
`imageable`, which serve the evaluation only, are not read. Every fault of a file raises `FloorError`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import StartError
from common.geometry import FloatArray, Points, Pose2, wrap_angle
from common.json_reader import Colour, Node, is_number, load_json
from offboard.simulator.building.polygons import (
    contains,
    crossings,
    distances_m,
    normalised_ring,
    ring_segments,
    signed_area_m2,
)

SIDE_MAX_M = 300.0
CORNERS_MAX = 1000  # of all rings: every edge is compared with every other
DOOR_MAX_M = 10.0
SIGN_MIN_M, SIGN_MAX_M = 0.01, 3.0
OFF_WALL_MAX_M = 0.15
START_CLEARANCE_M = 0.25
_SMALLEST_RING_M2 = 1e-4

Ring = tuple[tuple[float, float], ...]


class FloorError(StartError):
    """A file that is no valid floor; the message names file, key and fault."""


@dataclass(frozen=True, slots=True)
class Plate:
    """A number plate on a door or on the wall beside it."""

    x_m: float
    y_m: float
    on_door: bool
    centre_height_m: float
    width_m: float
    height_m: float
    number_height_m: float  # of the capitals
    style: str  # "dark on light", "light on dark", "dark on metal"


@dataclass(frozen=True, slots=True)
class Door:
    """A closed door: its centre on the wall; the normal points into the corridor."""

    x_m: float
    y_m: float
    normal_rad: float
    width_m: float
    height_m: float
    colour_rgb: Colour
    number: str
    room_type: str
    plate: Plate


@dataclass(frozen=True, slots=True)
class Poster:
    """A poster on a wall, which poi must not take for a plate."""

    x_m: float
    y_m: float
    normal_rad: float
    width_m: float
    height_m: float
    centre_height_m: float
    text: str


@dataclass(frozen=True, slots=True)
class Floor:
    """One floor: `exterior` counter-clockwise, `holes` clockwise, so that the corridor is on the left of every edge."""

    name: str
    wall_colour_rgb: Colour
    exterior: Ring
    holes: tuple[Ring, ...]
    doors: tuple[Door, ...]
    posters: tuple[Poster, ...]
    starts: tuple[Pose2, ...]


def wall_segments(floor: Floor) -> FloatArray:
    """(N, 4) x0, y0, x1, y1 in metres: every wall, directed with the corridor on its left."""
    return np.vstack([ring_segments(np.array(ring)) for ring in (floor.exterior, *floor.holes)])


def load_floor(path: str | Path) -> Floor:
    """The floor in a JSON file; raises FloorError."""
    source = f"floor file {path}"
    return parse_floor(load_json(Path(path), source, FloorError), source)


def parse_floor(content: Any, source: str) -> Floor:
    """The floor in a parsed JSON document; `source` ("floor file F") begins every FloorError."""
    reader = Node(content, source, FloorError)
    if reader.text("units") != "m":
        raise reader.error("units", 'must be "m"')
    corridor = reader.child("corridor")
    exterior = read_ring(corridor, "exterior", corridor.value("exterior"), counter_clockwise=True)
    holes = [
        read_ring(corridor, f"holes[{i}]", hole, counter_clockwise=False)
        for i, hole in enumerate(corridor.items("holes"))
    ]
    _check_size(corridor, exterior, holes)
    _check_holes(corridor, exterior, holes)
    floor = Floor(
        name=reader.text("name"),
        wall_colour_rgb=reader.colour("wall_colour_rgb"),
        exterior=tuple(map(tuple, exterior.tolist())),
        holes=tuple(tuple(map(tuple, hole.tolist())) for hole in holes),
        doors=tuple(_door(node) for node in reader.children("doors")),
        posters=tuple(_poster(node) for node in reader.children("posters")),
        starts=tuple(
            Pose2(node.number("x_m"), node.number("y_m"), wrap_angle(radians(node.number("heading_deg"))))
            for node in reader.children("starts")
        ),
    )
    _check_places(floor, reader, exterior, holes)
    return floor


def read_ring(node: Node, key: str, value: Any, counter_clockwise: bool) -> Points:
    """A ring in its normal form; raises what the node raises unless it encloses an area and never crosses itself."""
    if not isinstance(value, list):
        raise node.error(key, "must be a list of corners")
    if len(value) > CORNERS_MAX:
        raise node.error(key, f"has more than {CORNERS_MAX} corners")
    for corner in value:
        if not isinstance(corner, list) or len(corner) != 2 or not all(is_number(v) for v in corner):
            raise node.error(key, "must be a list of corners [x, y]")
    ring = normalised_ring(np.array(value, dtype=np.float64).reshape(-1, 2), counter_clockwise)
    open_polygon = "is an open polygon: it needs at least 3 distinct corners around an area"
    if len(np.unique(ring, axis=0)) < 3:
        raise node.error(key, open_polygon)
    edges = ring_segments(ring)
    for i, j in crossings(edges, edges):
        if i != j:
            raise node.error(key, f"crosses itself at its edges {min(i, j)} and {max(i, j)}")
    if abs(signed_area_m2(ring)) < _SMALLEST_RING_M2:
        raise node.error(key, open_polygon)
    return ring


def _check_size(corridor: Node, exterior: Points, holes: list[Points]) -> None:
    side_m = float(np.ptp(exterior, axis=0).max())
    if side_m > SIDE_MAX_M:
        raise corridor.error("exterior", f"is {side_m:.0f} m long, at most {SIDE_MAX_M:g} m is possible")
    if len(exterior) + sum(map(len, holes)) > CORNERS_MAX:
        raise corridor.error("", f"has more than {CORNERS_MAX} corners")


def _check_holes(corridor: Node, exterior: Points, holes: list[Points]) -> None:
    for i, hole in enumerate(holes):
        if not contains(exterior, hole).all() or len(crossings(ring_segments(hole), ring_segments(exterior))):
            raise corridor.error(f"holes[{i}]", "lies outside the exterior")
        for j, other in enumerate(holes[:i]):
            if contains(other, hole).any() or contains(hole, other).any():
                raise corridor.error(f"holes[{i}]", f"overlaps holes[{j}]")
            if len(crossings(ring_segments(hole), ring_segments(other))):
                raise corridor.error(f"holes[{i}]", f"overlaps holes[{j}]")


def _door(node: Node) -> Door:
    plate = node.child("plate")
    return Door(
        x_m=node.number("x_m"),
        y_m=node.number("y_m"),
        normal_rad=wrap_angle(radians(node.number("normal_deg"))),
        width_m=node.length("width_m", at_most=DOOR_MAX_M),
        height_m=node.length("height_m", at_most=DOOR_MAX_M),
        colour_rgb=node.colour("colour_rgb"),
        number=node.text("number"),
        room_type=node.text("room_type"),
        plate=Plate(
            x_m=plate.number("x_m"),
            y_m=plate.number("y_m"),
            on_door=plate.flag("on_door"),
            centre_height_m=plate.length("centre_height_m"),
            width_m=plate.length("width_m", SIGN_MIN_M, SIGN_MAX_M),
            height_m=plate.length("height_m", SIGN_MIN_M, SIGN_MAX_M),
            number_height_m=plate.length("number_height_m", at_most=SIGN_MAX_M),
            style=plate.text("style"),
        ),
    )


def _poster(node: Node) -> Poster:
    return Poster(
        x_m=node.number("x_m"),
        y_m=node.number("y_m"),
        normal_rad=wrap_angle(radians(node.number("normal_deg"))),
        width_m=node.length("width_m", SIGN_MIN_M, SIGN_MAX_M),
        height_m=node.length("height_m", SIGN_MIN_M, SIGN_MAX_M),
        centre_height_m=node.length("centre_height_m"),
        text=node.text("text"),
    )


def _check_places(floor: Floor, reader: Node, exterior: Points, holes: list[Points]) -> None:
    walls = wall_segments(floor)

    def check_on_wall(key: str, x_m: float, y_m: float) -> None:
        off_m = float(distances_m(walls, x_m, y_m).min())
        if off_m > OFF_WALL_MAX_M:
            raise reader.error(key, f"is {off_m:.2f} m from the nearest wall, at most {OFF_WALL_MAX_M} m is possible")

    for i, door in enumerate(floor.doors):
        check_on_wall(f"doors[{i}]", door.x_m, door.y_m)
        check_on_wall(f"doors[{i}].plate", door.plate.x_m, door.plate.y_m)
    for i, poster in enumerate(floor.posters):
        check_on_wall(f"posters[{i}]", poster.x_m, poster.y_m)
    if not floor.starts:
        raise reader.error("starts", "must have at least one start pose")
    for i, start in enumerate(floor.starts):
        at = np.array([[start.x_m, start.y_m]])
        if not contains(exterior, at)[0] or any(contains(hole, at)[0] for hole in holes):
            raise reader.error(f"starts[{i}]", "is not inside the corridor")
        clear_m = float(distances_m(walls, start.x_m, start.y_m).min())
        if clear_m < START_CLEARANCE_M:
            raise reader.error(f"starts[{i}]", f"is {clear_m:.2f} m from a wall, the robot needs {START_CLEARANCE_M} m")
