"""A scripted drive along every wall with the camera on it: a floor in, its places in order and where to stop out.

The camera looks to the right, so each wall is driven along once, in the direction that has it on the right: round the
exterior counter-clockwise, round islands clockwise. In front of every stretch of wall the drive is parallel to it, in
the middle of narrow halls and WALL_M away in wide ones, from end to end and on past corners that stand out. At corners
the robot stands square to the wall: at the end of a hall and in niches there is little more than these stops.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from common.geometry import FloatArray, Points, wrap_angles
from offboard.simulator.building.floor import Floor, wall_segments
from offboard.simulator.run.free_floor import CLEARANCE_M, FreeFloor, path_to

STEP_M = 0.1  # between places of a stretch
WALL_M = 1.4  # from the wall, where the hall is at least twice as wide
WALL_MAX_M = 2.2  # from further away plates are too small
STRETCH_MIN_M = 0.5  # no door fits a shorter piece of wall
PAST_M = 0.5  # on past a corner that stands out
CORNER_RAD = 0.4  # between two walls, at least; a slighter bend is driven through
NARROW_PERCENT = 30  # of a wall's length lies in a hall that is narrower than the one that its distance is chosen for
JUMP_M = 0.25  # between neighbouring places of a stretch: further apart it is parted

Looks = dict[int, float]  # index of a place -> heading in which the robot stands there (rad)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A drive (N, 2) parallel to a piece of wall, which is on its right; `stops`: at its begin, at its end."""

    places: Points
    heading_rad: float
    stops: tuple[bool, bool]


def route_along_walls(floor: Floor, free: FreeFloor, start: Points) -> tuple[Points, Looks]:
    """The places (N, 2) from `start` (2,) along all walls that can be reached and back, and the stops at them."""
    here = home = free.nearest(start)
    rings = [stretches for ring in _rings(floor) if (stretches := list(_of_ring(ring, floor, free)))]
    places: list[Points] = [free.places[[here]]]
    looks: Looks = {}
    while rings:
        costs, _ = free.costs_from(here)
        near = [min((float(costs[free.nearest(s.places[0])]), i) for i, s in enumerate(ring)) for ring in rings]
        nearest = min(range(len(rings)), key=lambda r: near[r])
        ring, first = rings.pop(nearest), near[nearest][1]
        for stretch in (*ring[first:], *ring[:first]):
            goal = free.nearest(stretch.places[0])
            costs, before = free.costs_from(here)
            if not np.isfinite(costs[goal]):
                continue
            places.append(free.places[path_to(goal, here, before)[1:-1]])
            begin = sum(map(len, places))
            places.append(stretch.places)
            ends = begin, begin + len(stretch.places) - 1
            looks |= {at: stretch.heading_rad for at, stops in zip(ends, stretch.stops, strict=True) if stops}
            here = free.nearest(stretch.places[-1])
    _, before = free.costs_from(here)
    places.append(free.places[path_to(home, here, before)])
    return np.concatenate(places), looks


def _rings(floor: Floor) -> Iterator[FloatArray]:
    """(N, 4) the walls of every ring, in order, with the corridor on their left."""
    walls, begin = wall_segments(floor), 0
    for ring in (floor.exterior, *floor.holes):
        yield walls[begin : begin + len(ring)]
        begin += len(ring)


def _of_ring(ring: FloatArray, floor: Floor, free: FreeFloor) -> Iterator[Stretch]:
    walls = wall_segments(floor)
    edges = ring[:, 2:] - ring[:, :2]
    headings_rad = np.arctan2(edges[:, 1], edges[:, 0])
    turns_rad = wrap_angles(headings_rad - np.roll(headings_rad, 1))  # at the begin of each
    for i, (wall, heading_rad) in enumerate(zip(ring, headings_rad.tolist(), strict=True)):
        turns = float(turns_rad[i]), float(turns_rad[(i + 1) % len(ring)])
        past_m = PAST_M * (turns[0] < -CORNER_RAD), PAST_M * (turns[1] < -CORNER_RAD)
        if np.hypot(*edges[i]) >= STRETCH_MIN_M:
            runs = list(_beside(wall, past_m, walls, free))
            for k, places in enumerate(runs):
                stops = k > 0 or abs(turns[0]) > CORNER_RAD, k < len(runs) - 1 or abs(turns[1]) > CORNER_RAD
                yield Stretch(places, heading_rad, stops)


def _beside(wall: FloatArray, past_m: tuple[float, float], walls: FloatArray, free: FreeFloor) -> Iterator[Points]:
    """The drives beside a wall: one, or several where something stands between them."""
    a, length_m = wall[:2], float(np.hypot(*(wall[2:] - wall[:2])))
    along = (wall[2:] - a) / length_m
    normal = np.array([-along[1], along[0]])
    s = np.arange(-past_m[0], length_m + past_m[1] + STEP_M / 2, STEP_M)
    inside = (s >= 0.0) & (s <= length_m)
    feet = a + s[:, None] * along
    widths_m = np.array([_width_m(foot + 0.02 * normal, normal, walls) for foot in feet])
    # One distance for all of it, so that the robot keeps parallel where a side hall begins
    wanted_m = min(WALL_M, float(np.percentile(widths_m[inside], NARROW_PERCENT)) / 2)
    options_m = np.arange(CLEARANCE_M, WALL_MAX_M, STEP_M / 2)
    chosen: list[tuple[int, float]] = []
    for i, foot in enumerate(feet):
        fits = free.is_open(foot + options_m[:, None] * normal)
        if inside[i]:  # nothing may stand between the wall and the robot
            fits &= options_m < widths_m[i]
        if fits.any():
            best = np.where(fits, np.abs(options_m - wanted_m), np.inf)
            chosen.append((i, float(options_m[best.argmin()])))
    run: list[tuple[int, float]] = []
    for i, distance_m in [*chosen, (len(s) + 9, 0.0)]:
        if run and (i != run[-1][0] + 1 or abs(distance_m - run[-1][1]) > JUMP_M):
            if any(inside[k] for k, _ in run):
                yield np.array([feet[k] + d * normal for k, d in run])
            run = []
        run.append((i, distance_m))


def _width_m(foot: Points, normal: Points, walls: FloatArray) -> float:
    """How far it is from a foot along the normal to the next wall."""
    origin, edge = walls[:, :2] - foot, walls[:, 2:] - walls[:, :2]
    across = normal[0] * edge[:, 1] - normal[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead_m = (origin[:, 0] * edge[:, 1] - origin[:, 1] * edge[:, 0]) / across
        share = (origin[:, 0] * normal[1] - origin[:, 1] * normal[0]) / across
    hits = ahead_m[(share >= 0.0) & (share <= 1.0) & (ahead_m > 0.0)]
    return float(hits.min()) if len(hits) else np.inf
