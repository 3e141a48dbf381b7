"""What did not work, where, and how long that counts: obstacles met, headings taken in vain, standing still.

The mission queries these memories before it tries a thing again. Deferred frontiers are in `frontiers`.
"""

from __future__ import annotations

from math import hypot, inf, radians

import numpy as np

from common.geometry import Pose2, wrap_angle
from onboard.planner.grid.grid_map import GridMap, Mask

BLOCK_RADIUS_M = 0.35
BLOCK_FOR_S = 25.0
BLOCK_TOLERANCE_M = 0.05  # a path was planned past it from cell to cell
STAGNANT_M = 0.1
STAGNANT_RAD = radians(20.0)
STAGNANT_S = 20.0
STAGNANT_STEP_MAX_S = 0.5  # of one step: a gap in the steps is no standing still
SAME_PLACE_M = 0.3
SAME_HEADING_RAD = radians(30.0)

Places = tuple[tuple[float, float], ...]  # in the map, metres


class Obstacles:
    """Obstacles that the map does not know: each is planned around for a while, and longer every time again."""

    def __init__(self) -> None:
        self._places: list[tuple[float, float, float]] = []  # where, and until when
        self._met: list[tuple[float, float]] = []
        self._new_until_s = -inf

    def add(self, x_m: float, y_m: float, now_s: float) -> None:
        """Something was met here, in the map."""
        earlier = sum(hypot(x_m - x, y_m - y) < BLOCK_RADIUS_M for x, y in self._met)
        self._met.append((x_m, y_m))
        self._places.append((x_m, y_m, now_s + BLOCK_FOR_S * 2.0**earlier))
        if not earlier:
            self._new_until_s = now_s + BLOCK_FOR_S

    def forget(self, now_s: float) -> bool:
        """Drop those whose time is over; was there one?"""
        before = len(self._places)
        self._places = [place for place in self._places if place[2] > now_s]
        return len(self._places) < before

    def may_hide_a_path(self, now_s: float) -> bool:
        """Was one met lately where none had been before?"""
        return now_s < self._new_until_s

    @property
    def places(self) -> Places:
        """Where they are."""
        return tuple((x_m, y_m) for x_m, y_m, _ in self._places)

    def on_leg(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Does one stand on the straight leg between two positions?"""
        reach_m = BLOCK_RADIUS_M - BLOCK_TOLERANCE_M
        return any(_distance_to_leg((x_m, y_m), a, b) < reach_m for x_m, y_m, _ in self._places)


def blocked_cells(grid: GridMap, obstacles: Places) -> Mask:
    """Cells (rows, columns) of the grid that lie around obstacles."""
    mask = np.zeros(grid.cells.shape, dtype=bool)
    reach = int(BLOCK_RADIUS_M / grid.cell_m) + 2
    for x_m, y_m in obstacles:
        row, column = grid.cell(x_m, y_m)
        r0, c0 = max(row - reach, 0), max(column - reach, 0)
        near = mask[r0 : max(row + reach, 0), c0 : max(column + reach, 0)]
        rows, columns = np.indices(near.shape)
        x = grid.origin_x_m + (columns + c0 + 0.5) * grid.cell_m
        y = grid.origin_y_m + (rows + r0 + 0.5) * grid.cell_m
        near |= np.hypot(x - x_m, y - y_m) < BLOCK_RADIUS_M
    return mask


class Stillness:
    """How long the robot has not moved while it was driving to a place, whatever the reason."""

    def __init__(self) -> None:
        self._anchor: Pose2 | None = None
        self._still_s = 0.0

    def stagnates(self, pose: Pose2, dt_s: float, under_way: bool) -> bool:
        """Take in the next step; True, once, when that has lasted too long."""
        anchor, self._still_s = self._anchor, self._still_s + min(dt_s, STAGNANT_STEP_MAX_S)
        if (
            anchor is None
            or not under_way
            or anchor.distance_m(pose) > STAGNANT_M
            or abs(wrap_angle(anchor.heading_rad - pose.heading_rad)) > STAGNANT_RAD
        ):
            self._anchor, self._still_s = pose, 0.0
        if self._still_s <= STAGNANT_S:
            return False
        self._anchor = None
        return True


class TriedBranches:
    """Headings taken, as pose and heading, that need not be tried again from about there."""

    def __init__(self) -> None:
        self._vain_legs: list[Pose2] = []
        self._sides: list[Pose2] = []

    def add_leg(self, start: Pose2, end: Pose2) -> None:
        """A straight leg ended; a short one led nowhere."""
        if start.distance_m(end) < SAME_PLACE_M:
            self._vain_legs.append(start)

    def add_side(self, branch: Pose2) -> None:
        """The robot turned to a side branch."""
        self._sides.append(branch)

    def leg_in_vain(self, branch: Pose2) -> bool:
        """Did driving straight on from here lead nowhere?"""
        return any(_same(branch, other) for other in self._vain_legs)

    def tried(self, branch: Pose2) -> bool:
        """Was this branch turned to, or a leg in vain?"""
        return self.leg_in_vain(branch) or any(_same(branch, other) for other in self._sides)


def _same(branch: Pose2, other: Pose2) -> bool:
    turn_rad = abs(wrap_angle(other.heading_rad - branch.heading_rad))
    return other.distance_m(branch) < SAME_PLACE_M and turn_rad < SAME_HEADING_RAD


def _distance_to_leg(p: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    f = max(0.0, min(1.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / max(dx * dx + dy * dy, 1e-9)))
    return hypot(p[0] - a[0] - f * dx, p[1] - a[1] - f * dy)
