"""What is still to be seen: the list of side halls as frontier groups, the path straight on, the opening on the right.

The list of the specification holds a side hall's position and heading when the robot passes it; here it is read off the
grid at any time: a group of frontier cells is a hall end or side hall that nobody has visited, and it leaves the
list by itself when somebody has. (Frontiers: Yamauchi 1997.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import atan2, cos, hypot, sin

import numpy as np
import numpy.typing as npt

from common.geometry import Points, Pose2
from common.grid_cells import UNKNOWN
from onboard.planner.exploration.recovery_memory import BLOCK_RADIUS_M, Places
from onboard.planner.exploration.unknown_floor import UnknownFloor
from onboard.planner.grid.grid_map import STAND_CLEARANCE_M, Cell, GridMap, Mask

GROUP_CELLS_MIN = 3
GROUP_COARSENESS = 2  # grid cells
SMALL_M = 1.0  # from end to end: an entry that is not worth a long way
ROOM_MIN_M2 = 0.8  # of unknown floor beyond an entry
STRAIGHT_MIN_M = 0.45
STRAIGHT_MAX_M = 6.0
STRAIGHT_BEGIN_M = 0.2  # where the robot stands is no wall
STRAIGHT_SIDE_M = 5.0  # frontier this far to the side is seen in passing
SEEN_FROM_AHEAD = 40  # cells of frontier at least that are looked at, of those that there are
OPENING_BEHIND_M = (-2.0, -0.5)  # where along the path an opening on the right is judged: when it was passed
OPENING_SIDE_M = (-3.0, -0.3)
OPENING_WIDTH_M = 0.6
LEFT_OUT_RADIUS_M = 0.45
CONSIDERED_MAX = 5_000  # cells that are considered one by one: the frontier of two hundred ends of halls
ROOMY_SHARE = 0.8  # of the best clearance in a group


Cells = npt.NDArray[np.int64]  # (N, 2) row, column


@dataclass(frozen=True, slots=True)
class Frontier:
    """Frontier cells (N, 2) and their centres (N, 2) in the map."""

    cells: Cells
    points: Points


@dataclass(frozen=True, slots=True, eq=False)
class FrontierGroup:
    """Neighbouring frontier cells (N, 2), their centres (N, 2), and the middle of these, in the map."""

    cells: Cells
    points: Points
    x_m: float
    y_m: float

    @property
    def width_m(self) -> float:
        """Of the opening: from end to end."""
        return float(np.hypot(*np.ptp(self.points, axis=0)))


WAS_VISITED, NO_PATH = "was visited, and no sonar shows more", "no path leads there"
TOO_LITTLE = "too little is to be seen there for the way"
NOWHERE = Frontier(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)))


class FrontierMemory:
    """The places that were visited or tried in vain."""

    def __init__(self) -> None:
        self._visited: list[tuple[float, float]] = []
        self._deferred: dict[tuple[float, float], str] = {}  # why
        self.second_try = False

    @property
    def left_out(self) -> tuple[tuple[float, float], ...]:
        """Places around which the frontier is not worth a visit now."""
        return (*self._visited, *self._deferred)

    def reason(self, points: Points) -> str:
        """Why an entry with this frontier (N, 2) is not on the list, or stays on it."""
        for reason, places in ((WAS_VISITED, self._visited), *((why, [at]) for at, why in self._deferred.items())):
            if any((np.hypot(points[:, 0] - x_m, points[:, 1] - y_m) < LEFT_OUT_RADIUS_M).any() for x_m, y_m in places):
                return reason
        return NO_PATH if np.hypot(*np.ptp(points, axis=0)) >= SMALL_M else TOO_LITTLE

    def mark_visited(self, x_m: float, y_m: float) -> None:
        """Whatever frontier is left around this position was visited: it will not be visited again."""
        self._visited.append((x_m, y_m))

    def defer(self, x_m: float, y_m: float, why: str) -> None:
        """Something kept the robot from this position: the frontier around it waits for the second try."""
        self._deferred[x_m, y_m] = why

    def try_again(self) -> bool:
        """Once, when all else is seen, bring back what was deferred; False where nothing was or it is used up."""
        if self.second_try or not self._deferred:
            return False
        self.second_try, self._deferred = True, {}
        return True


def worth_a_visit(grid: GridMap, blocked: Mask, pose: Pose2, left_out: Iterable[tuple[float, float]] = ()) -> Frontier:
    """Frontier cells that are still worth a visit, from this pose."""
    cells = considered(grid, grid.frontier & ~blocked, pose)
    points = grid.centres(cells)
    keep = np.ones(len(cells), dtype=bool)
    for x_m, y_m in left_out:
        keep &= np.hypot(points[:, 0] - x_m, points[:, 1] - y_m) >= LEFT_OUT_RADIUS_M
    return Frontier(cells[keep], points[keep])


def groups(frontier: Frontier, unknown: UnknownFloor) -> list[FrontierGroup]:
    """Groups of at least GROUP_CELLS_MIN frontier cells that lie next to each other (within a coarse cell), with
    unknown floor beyond that is worth a visit."""
    members: dict[tuple[int, int], list[int]] = {}
    for i, (r, c) in enumerate((frontier.cells // GROUP_COARSENESS).tolist()):
        members.setdefault((r, c), []).append(i)
    found: list[FrontierGroup] = []
    while members:
        key, indices = members.popitem()
        stack = [key]
        while stack:
            r, c = stack.pop()
            for near in ((r + i, c + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
                if near in members:
                    indices += members.pop(near)
                    stack.append(near)
        indices.sort()
        room_m2 = unknown.beyond_m2(frontier.cells[indices]) if len(indices) >= GROUP_CELLS_MIN else 0.0
        if room_m2 >= ROOM_MIN_M2:
            middle = frontier.points[indices].mean(axis=0)
            found.append(
                FrontierGroup(frontier.cells[indices], frontier.points[indices], float(middle[0]), float(middle[1]))
            )
    return found


def roomy_cells(grid: GridMap, listed: Iterable[FrontierGroup]) -> set[Cell]:
    """Where to go for the entries of the list: of every group the cells away from the walls."""
    wanted: set[Cell] = set()
    for group in listed:
        clearance_m = grid.clearance_m(tuple(group.cells.T))
        wanted |= as_set(group.cells[clearance_m >= ROOMY_SHARE * clearance_m.max()])
    return wanted


def entrance(grid: GridMap, group: FrontierGroup) -> Cell:
    """Of an entry of the list: the cell furthest from walls, and of those the one next to its middle."""
    clearance_m = grid.clearance_m(tuple(group.cells.T))
    roomiest = group.cells[clearance_m == clearance_m.max()]
    gap = grid.centres(roomiest) - np.array([group.x_m, group.y_m])
    row, column = roomiest[np.hypot(gap[:, 0], gap[:, 1]).argmin()].tolist()
    return row, column


def together(listed: Iterable[FrontierGroup]) -> Frontier:
    """The frontier of some entries."""
    each = list(listed)
    if not each:
        return NOWHERE
    return Frontier(np.concatenate([g.cells for g in each]), np.concatenate([g.points for g in each]))


def considered(grid: GridMap, mask: Mask, pose: Pose2) -> Cells:
    """Cells (N, 2) of a mask: all, or of too many those around a pose. The others come up as the robot does."""
    row, column = grid.cell(pose.x_m, pose.y_m)
    reach = max(*mask.shape, abs(row), abs(column)) + 1
    while True:
        r0, c0 = max(row - reach, 0), max(column - reach, 0)
        near = mask[r0 : max(row + reach, 0), c0 : max(column + reach, 0)]
        if np.count_nonzero(near) <= CONSIDERED_MAX:
            cells: Cells = np.argwhere(near) + np.array([r0, c0])
            return cells
        reach //= 2


def as_set(cells: Cells) -> set[Cell]:
    """Cells (N, 2) as pairs, to look one up."""
    return {(r, c) for r, c in cells.tolist()}


def straight_reach_m(grid: GridMap, pose: Pose2, heading_rad: float, obstacles: Places = ()) -> float:
    """How far (metres) the footprint can go straight on by the grid, at most STRAIGHT_MAX_M.

    Unknown floor counts as open, the surroundings of obstacles do not.
    """
    along = cos(heading_rad), sin(heading_rad)
    rows, columns = grid.line(
        (pose.x_m, pose.y_m), (pose.x_m + STRAIGHT_MAX_M * along[0], pose.y_m + STRAIGHT_MAX_M * along[1])
    )
    tight = grid.clearance_m((rows, columns)) < STAND_CLEARANCE_M
    distance = np.arange(len(rows)) * (STRAIGHT_MAX_M / (len(rows) - 1))
    for x_m, y_m in obstacles:
        tight |= np.hypot(pose.x_m + distance * along[0] - x_m, pose.y_m + distance * along[1] - y_m) < BLOCK_RADIUS_M
    tight &= distance > STRAIGHT_BEGIN_M
    return float(distance[tight.argmax()]) if tight.any() else STRAIGHT_MAX_M


def something_ahead(
    grid: GridMap, frontier: Frontier, pose: Pose2, heading_rad: float, reach_m: float, side_m: float = STRAIGHT_SIDE_M
) -> bool:
    """Is there frontier that will be seen in passing by driving straight on for `reach_m`, up to `side_m` aside?"""
    if reach_m < STRAIGHT_MIN_M:
        return False
    points = _relative(frontier, pose, heading_rad)
    ahead = (points[:, 0] > 0.15) & (points[:, 0] < reach_m + 0.5) & (np.abs(points[:, 1]) < side_m)
    if not ahead.any():
        return False
    every = max(1, np.count_nonzero(ahead) // SEEN_FROM_AHEAD)
    along_m = points[ahead][::every, :1]
    beside = np.array([pose.x_m, pose.y_m]) + along_m * np.array([cos(heading_rad), sin(heading_rad)])
    return bool(grid.sees_each(beside, frontier.points[ahead][::every]).any())


def opening_on_the_right(grid: GridMap, frontier: Frontier, pose: Pose2, heading_rad: float) -> Cells | None:
    """Frontier cells (N, 2) of an opening on the right, just passed and wide enough to enter; None = no opening."""
    points = _relative(frontier, pose, heading_rad)
    passed = (
        (points[:, 0] > OPENING_BEHIND_M[0])
        & (points[:, 0] < OPENING_BEHIND_M[1])
        & (points[:, 1] > OPENING_SIDE_M[0])
        & (points[:, 1] < OPENING_SIDE_M[1])
    )
    if not passed.any() or np.ptp(points[passed, 0]) < OPENING_WIDTH_M:
        return None
    # From where it was abeam: an edge of the opening hides what is inside from a robot that has passed it
    abeam = np.array([pose.x_m, pose.y_m]) + points[passed, :1] * np.array([cos(heading_rad), sin(heading_rad)])
    seen = grid.sees_each(abeam, frontier.points[passed])
    if seen.sum() < GROUP_CELLS_MIN or np.ptp(points[passed][seen, 0]) < OPENING_WIDTH_M:
        return None
    opening: Cells = frontier.cells[passed][seen]
    return opening


def unknown_direction_rad(grid: GridMap, x_m: float, y_m: float, fallback_rad: float) -> float:
    """Direction in the map from a position to the unknown floor within sight around it."""
    row, column = grid.cell(x_m, y_m)
    reach = round(1.0 / grid.cell_m)
    r0, c0 = max(row - reach, 0), max(column - reach, 0)
    window = grid.cells[r0 : row + reach + 1, c0 : column + reach + 1]
    unknown = np.argwhere(window == UNKNOWN)
    if not len(unknown):
        return fallback_rad
    here = np.array([x_m, y_m])
    centres = grid.centres(unknown + np.array([r0, c0]))
    seen = grid.sees_each(here, centres[::3])
    points = (centres[::3][seen] if seen.any() else centres) - here
    dx, dy = points.mean(axis=0)
    return atan2(float(dy), float(dx)) if hypot(float(dx), float(dy)) > 0.1 else fallback_rad


def _relative(frontier: Frontier, pose: Pose2, heading_rad: float) -> Points:
    """Frontier points as (N, 2): forward and left of the robot."""
    d = frontier.points - np.array([pose.x_m, pose.y_m])
    c, s = cos(heading_rad), sin(heading_rad)
    return np.stack([d[:, 0] * c + d[:, 1] * s, -d[:, 0] * s + d[:, 1] * c], axis=1)
