"""What happens on a floor while the robot maps it: people walk, a hall is blocked, a door opens, the robot is turned.

Reads a JSON file; all lists may be missing:

    {"people":  [{"from_s": 20, "to_s": 60, "speed_m_s": 1.0, "radius_m": 0.25, "waypoints": [[x, y], ...]}],
     "blocked": [{"from_s": 30, "to_s": 90, "line": [[x, y], [x, y]]}],
     "opened":  [{"at_s": 40, "door": "204", "room": [[x, y], ...]}],
     "turned":  [{"from_s": 50, "to_s": 52, "angle_deg": 40}],
     "battery": {"empty_s": 600}}

A person appears at `from_s`, walks along the waypoints, stands at the last one and disappears at `to_s`. A barrier
blocks a hall along a line. A door, named by its number, opens into a room, a polygon behind the wall. A person turns
the robot by hand, counter-clockwise for a positive angle; its wheels do not turn. The battery falls evenly from full to
empty; then the board has no power.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, radians, sin
from pathlib import Path

import numpy as np

from common.errors import StartError
from common.geometry import FloatArray
from common.json_reader import Node, load_json
from offboard.simulator.building.floor import Door, Floor, read_ring, wall_segments
from offboard.simulator.building.polygons import normalised_ring, ring_segments

BARRIER_THICKNESS_M = 0.10
FULL_MV, STEADY_MV, EMPTY_MV = 12_600, 12_000, 9_900  # of three cells; below that their own circuit cuts them off
# How far behind and in front of the door's centre a wall belongs to its opening
_OPENING_BEHIND_M, _OPENING_FRONT_M = 0.60, 0.20


class EventsError(StartError):
    """A file that is no valid list of events; the message names file, key and fault."""


@dataclass(frozen=True, slots=True)
class Person:
    """A person, as a cylinder that walks along waypoints (x, y in metres)."""

    from_s: float
    to_s: float
    speed_m_s: float
    radius_m: float
    waypoints: tuple[tuple[float, float], ...]

    def position(self, now_s: float) -> tuple[float, float] | None:
        """(x, y) in metres; None while the person is absent."""
        if not self.from_s <= now_s < self.to_s:
            return None
        left_m = (now_s - self.from_s) * self.speed_m_s
        for (x0, y0), (x1, y1) in zip(self.waypoints, self.waypoints[1:], strict=False):
            length_m = hypot(x1 - x0, y1 - y0)
            if left_m < length_m:
                return x0 + (x1 - x0) * left_m / length_m, y0 + (y1 - y0) * left_m / length_m
            left_m -= length_m
        return self.waypoints[-1]


@dataclass(frozen=True, slots=True)
class Barrier:
    """A barrier across a hall: BARRIER_THICKNESS_M thick along `line` (x0, y0, x1, y1 in metres)."""

    from_s: float
    to_s: float
    line: tuple[float, float, float, float]

    def segments(self) -> FloatArray:
        """(4, 4): the faces of the barrier."""
        x0, y0, x1, y1 = self.line
        length_m = hypot(x1 - x0, y1 - y0)
        across = np.array([-(y1 - y0), x1 - x0]) / length_m * BARRIER_THICKNESS_M / 2
        a, b = np.array([x0, y0]), np.array([x1, y1])
        corners = np.array([a + across, b + across, b - across, a - across])
        return ring_segments(normalised_ring(corners, counter_clockwise=False))


@dataclass(frozen=True, slots=True)
class OpenedDoor:
    """A door that opens into a room and stays open."""

    at_s: float
    door: Door
    room: FloatArray  # (N, 4) its walls


@dataclass(frozen=True, slots=True)
class HandTurn:
    """A person turns the robot at an even rate, without turning its wheels."""

    from_s: float
    to_s: float
    angle_rad: float


@dataclass(frozen=True, slots=True)
class Battery:
    """Falls evenly from full to empty."""

    empty_s: float = inf  # without an end: one that stays as it is

    def millivolts(self, now_s: float) -> int:
        if self.empty_s == inf:
            return STEADY_MV
        return round(FULL_MV - (FULL_MV - EMPTY_MV) * min(now_s / self.empty_s, 1.0))


@dataclass(frozen=True, slots=True)
class Events:
    """All events of a run, on the clock of the world (seconds since power-on)."""

    people: tuple[Person, ...] = ()
    barriers: tuple[Barrier, ...] = ()
    opened: tuple[OpenedDoor, ...] = ()
    turns: tuple[HandTurn, ...] = ()
    battery: Battery = Battery()

    def change_times_s(self) -> list[float]:
        """Times in seconds at which walls change, in order."""
        times = {t for barrier in self.barriers for t in (barrier.from_s, barrier.to_s) if t != inf}
        return sorted(times | {opened.at_s for opened in self.opened})

    def walls_at(self, floor: Floor, now_s: float) -> FloatArray:
        """(N, 4), metres: every wall that stands at that time, each with the free space on its left."""
        walls = wall_segments(floor)
        for opened in self.opened:
            if opened.at_s <= now_s:
                walls = _open(walls, opened)
        standing = [b.segments() for b in self.barriers if b.from_s <= now_s < b.to_s]
        return np.vstack([walls, *standing])

    def hand_turn_rate_rad_s(self, now_s: float) -> float:
        """The yaw rate (rad/s) that people give the robot at that time."""
        return sum(t.angle_rad / (t.to_s - t.from_s) for t in self.turns if t.from_s <= now_s < t.to_s)

    def open_doors(self, now_s: float) -> tuple[Door, ...]:
        """The doors that stand open at that time."""
        return tuple(opened.door for opened in self.opened if opened.at_s <= now_s)


def load_events(path: str | Path, floor: Floor) -> Events:
    """The events of a JSON file, whose doors must be doors of `floor`. Raises EventsError."""
    source = f"events file {path}"
    reader = Node(load_json(Path(path), source, EventsError), source, EventsError)
    return Events(
        people=tuple(_person(node) for node in reader.optional_children("people")),
        barriers=tuple(_barrier(node) for node in reader.optional_children("blocked")),
        opened=tuple(_opened(node, floor) for node in reader.optional_children("opened")),
        turns=tuple(_hand_turn(node) for node in reader.optional_children("turned")),
        battery=Battery(reader.child("battery").length("empty_s")) if reader.has("battery") else Battery(),
    )


def _interval(node: Node) -> tuple[float, float]:
    from_s = node.number("from_s")
    to_s = node.number("to_s") if node.has("to_s") else inf
    if to_s <= from_s:
        raise node.error("to_s", "must be later than from_s")
    return from_s, to_s


def _person(node: Node) -> Person:
    from_s, to_s = _interval(node)
    points = node.points("waypoints", node.value("waypoints"), at_least=1)
    return Person(
        from_s=from_s,
        to_s=to_s,
        speed_m_s=node.length("speed_m_s"),
        radius_m=node.length("radius_m", at_most=2.0) if node.has("radius_m") else 0.25,
        waypoints=tuple((float(x), float(y)) for x, y in points),
    )


def _barrier(node: Node) -> Barrier:
    from_s, to_s = _interval(node)
    points = node.points("line", node.value("line"), at_least=2)
    if len(points) != 2 or np.hypot(*(points[1] - points[0])) < BARRIER_THICKNESS_M:
        raise node.error("line", f"must be two points more than {BARRIER_THICKNESS_M} m apart")
    x0, y0, x1, y1 = points.ravel().tolist()
    return Barrier(from_s, to_s, (x0, y0, x1, y1))


def _hand_turn(node: Node) -> HandTurn:
    from_s, _ = _interval(node)
    return HandTurn(from_s, node.number("to_s"), radians(node.number("angle_deg")))


def _opened(node: Node, floor: Floor) -> OpenedDoor:
    number = node.text("door")
    doors = [door for door in floor.doors if door.number == number]
    if not doors:
        raise node.error("door", f"names {number!r}, which is no door of this floor")
    room = ring_segments(read_ring(node, "room", node.value("room"), counter_clockwise=True))
    opened = OpenedDoor(node.number("at_s"), doors[0], room)
    for walls, what in ((room, "the room"), (wall_segments(floor), "the corridor")):
        if not _cut(walls, doors[0])[1]:
            raise node.error("room", f"does not fit: no wall of {what} stands at door {number}")
    return opened


def _open(walls: FloatArray, opened: OpenedDoor) -> FloatArray:
    """The walls with the room, an opening where the door was, and its two jambs."""
    door = opened.door
    kept, offsets = _cut(np.vstack([walls, opened.room]), door)
    front_m, behind_m = max(offsets), min(offsets)
    normal = np.array([cos(door.normal_rad), sin(door.normal_rad)])
    along = np.array([normal[1], -normal[0]])
    centre = np.array([door.x_m, door.y_m])
    jambs = []
    if front_m - behind_m > 0.01:
        for side, start_m, end_m in ((0.5, behind_m, front_m), (-0.5, front_m, behind_m)):
            edge = centre + side * door.width_m * along
            jambs.append(np.hstack([edge + start_m * normal, edge + end_m * normal]))
    return np.vstack([kept, *jambs])


def _cut(walls: FloatArray, door: Door) -> tuple[FloatArray, list[float]]:
    """The walls without what runs across the door's opening, and how far each such wall is in front of its centre."""
    normal_x, normal_y = cos(door.normal_rad), sin(door.normal_rad)
    half_m = door.width_m / 2
    kept, offsets = [], []
    for x0, y0, x1, y1 in walls.tolist():
        along = [(x - door.x_m) * normal_y - (y - door.y_m) * normal_x for x, y in ((x0, y0), (x1, y1))]
        front = [(x - door.x_m) * normal_x + (y - door.y_m) * normal_y for x, y in ((x0, y0), (x1, y1))]
        span_m = along[1] - along[0]
        parallel = abs(span_m) > 10.0 * abs(front[1] - front[0])
        between = -_OPENING_BEHIND_M < front[0] < _OPENING_FRONT_M
        if not (parallel and between and min(along) < half_m and max(along) > -half_m):
            kept.append((x0, y0, x1, y1))
            continue
        offsets.append((front[0] + front[1]) / 2)
        shares = sorted(min(max((edge - along[0]) / span_m, 0.0), 1.0) for edge in (-half_m, half_m))
        for start, end in ((0.0, shares[0]), (shares[1], 1.0)):
            if (end - start) * abs(span_m) > 1e-3:
                kept.append(
                    (x0 + start * (x1 - x0), y0 + start * (y1 - y0), x0 + end * (x1 - x0), y0 + end * (y1 - y0))
                )
    return np.array(kept, dtype=np.float64).reshape(-1, 4), offsets
