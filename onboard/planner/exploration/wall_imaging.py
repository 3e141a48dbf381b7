"""Which walls the camera has seen, and where to drive along those that it has not.

The camera looks to the right, so a hall that was driven one way shows one of its walls. What a drive has shown is kept
as cells of the map; the rest of the walls on the grid gives spots to stand on with a heading, the wall on the right.
(The coverage part of view planning: Scott, Roth & Rivest 2003, "View planning for automated three-dimensional object
reconstruction and inspection", here with one look per cell of wall.)
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import cos, pi, radians, sin

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from common.constants import CAMERA_FIELD_OF_VIEW_RAD, CAMERA_INCIDENCE_MAX_RAD, CAMERA_RANGE_M
from common.geometry import FloatArray, Points, Pose2, wrap_angle, wrap_angles
from common.grid_cells import WALL
from onboard.planner.exploration.frontiers import Cells, considered
from onboard.planner.grid.grid_map import Cell, GridMap, Mask
from onboard.planner.grid.grid_reading import tiles

SPACING_M = 0.1  # between two looks
TURNED_RAD = radians(5.0)
RECENT_LOOKS = 15  # are judged once more when that many came after: a wall comes onto the grid after it was passed
LINE_REACH_CELLS = 3  # around a cell of wall, for the wall's direction
LINE_CELLS_MIN = 4
LINE_SHARE = 0.7  # by how much the cells lie along one direction: 1 on a line, 0 in a round blot
UNSEEN_REACH_CELLS = 6  # around a cell of wall that was not seen,
UNSEEN_CELLS_MIN = 10  # so many of the kind are worth a visit: what could hold a door
DISTANCES_M = (1.5, 1.2, 0.9, 0.6)  # from the wall, best first
SIGHT_GAP_M = 0.2  # a sight line ends before the wall itself
AHEAD_M = (-0.3, 2.0)  # along the path, in which an unseen wall on the right is worth going on for
SAME_WALL_RAD = radians(30.0)
SAME_WALL_M = 1.0
TILE_CELLS = 200  # of a large grid, along both axes
HALO_CELLS = LINE_REACH_CELLS + UNSEEN_REACH_CELLS + 1  # around a tile: as far as one cell matters to another
GROWTH_CELLS = 64  # of what was seen, beyond what is needed


class SeenWalls:
    """Cells of wall that were seen, by their place in the map, whatever part of it a grid shows."""

    def __init__(self) -> None:
        self._first: Cell = (0, 0)  # of the mask, in cells from the origin of the map
        self._mask: Mask = np.zeros((0, 0), dtype=bool)

    def copy(self) -> SeenWalls:
        other = SeenWalls()
        other._first, other._mask = self._first, self._mask.copy()
        return other

    def add(self, grid: GridMap, cells: Cells) -> None:
        """Cells (N, 2) of a grid."""
        if not len(cells):
            return
        at = cells + np.array(_offset(grid))
        self._reach(at.min(axis=0), at.max(axis=0) + 1)
        self._mask[tuple((at - np.array(self._first)).T)] = True

    def on(self, grid: GridMap) -> Mask:
        """Which cells (rows, columns) of a grid they are."""
        seen = np.zeros(grid.cells.shape, dtype=bool)
        shift = np.array(self._first) - np.array(_offset(grid))
        low = np.maximum(shift, 0)
        high = np.minimum(shift + self._mask.shape, seen.shape)
        if (low < high).all():
            (r0, c0), (r1, c1) = low.tolist(), high.tolist()
            r, c = shift.tolist()
            seen[r0:r1, c0:c1] = self._mask[r0 - r : r1 - r, c0 - c : c1 - c]
        return seen

    def _reach(self, low: Cells, high: Cells) -> None:
        """Makes the mask hold the cells from `low` to before `high`, (2,) each."""
        if not self._mask.size:
            self._first = (int(low[0]), int(low[1]))
        first = np.array(self._first)
        before, after = np.maximum(first - low, 0), np.maximum(high - first - self._mask.shape, 0)
        if not (before.any() or after.any()):
            return
        before, after = (np.where(missing, missing + GROWTH_CELLS, 0) for missing in (before, after))
        self._mask = np.pad(self._mask, np.stack([before, after], axis=1))
        self._first = (int(first[0] - before[0]), int(first[1] - before[1]))


@dataclass(frozen=True, slots=True)
class Imaged:
    """What was seen, and the newest poses, from which a wall that comes onto the grid later was seen too."""

    seen: SeenWalls
    recent: tuple[Pose2, ...]


class WallImaging:
    """What was seen so far. `look` takes in where the robot is; the rest are queries."""

    def __init__(self) -> None:
        self._seen = SeenWalls()
        self._recent: deque[Pose2] = deque(maxlen=RECENT_LOOKS)
        self._last: Pose2 | None = None

    @property
    def imaged(self) -> Imaged:
        """As it is now."""
        return Imaged(self._seen.copy(), tuple(self._recent))

    def look(self, grid: GridMap, pose: Pose2) -> None:
        """The robot is here now; while it turns, the camera sees nothing sharply."""
        last, self._last = self._last, pose
        if last is None or abs(wrap_angle(last.heading_rad - pose.heading_rad)) > TURNED_RAD / 5:
            return
        newest = self._recent[-1] if self._recent else None
        if (
            newest is not None
            and newest.distance_m(pose) < SPACING_M
            and abs(wrap_angle(newest.heading_rad - pose.heading_rad)) < TURNED_RAD
        ):
            return
        if len(self._recent) == RECENT_LOOKS:
            _add(self._seen, grid, self._recent[0])
        self._recent.append(pose)
        _add(self._seen, grid, pose)

    def settle(self, grid: GridMap, pose: Pose2) -> None:
        """Counts all walls in view from here as seen, even at a bad angle: they are not visited again."""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        self._seen.add(near, _in_view(near, pose)[0])

    def shows_new(self, grid: GridMap, pose: Pose2) -> bool:
        """Is there an unseen wall in the field of view of a robot that stands like that?"""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        return bool(self.unseen(near)[tuple(_seen_well(near, pose).T)].any())

    def unseen(self, grid: GridMap) -> Mask:
        """Cells (rows, columns) of walls that nobody has looked at; corners and blots do not count."""
        return _unseen(grid, self._seen, wall_normals(grid))

    def worth_going_on(self, grid: GridMap, pose: Pose2, heading_rad: float) -> bool:
        """Will driving on along this heading show an unseen wall on the right before long?"""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        cells = np.argwhere(self.unseen(near))
        c, s = cos(heading_rad), sin(heading_rad)
        here, walls = np.array([pose.x_m, pose.y_m]), near.centres(cells)
        d = walls - here
        along, right = d[:, 0] * c + d[:, 1] * s, d[:, 0] * s - d[:, 1] * c
        ahead = (along > AHEAD_M[0]) & (along < AHEAD_M[1]) & (right > 0.0) & (right < CAMERA_RANGE_M)
        beside = here + along[ahead, None] * np.array([c, s])
        return bool(_sees_walls(near, beside, walls[ahead]).any())


def spots(grid: GridMap, imaged: Imaged, here: Pose2) -> dict[Cell, float]:
    """Where to stand to see what is unseen, and the heading there, radians in the map; `here` is the robot."""
    seen = imaged.seen.copy()
    for pose in imaged.recent:
        _add(seen, grid, pose)
    normals_rad, unseen = np.zeros(grid.cells.shape), np.zeros(grid.cells.shape, dtype=bool)
    for tile, around, inside in tiles(grid.cells.shape, TILE_CELLS, HALO_CELLS):
        part = grid.part(around)
        normals = wall_normals(part)
        normals_rad[tile], unseen[tile] = normals[inside], _unseen(part, seen, normals)[inside]
    cells = considered(grid, unseen, here)
    towards_rad = (normals_rad[tuple(cells.T)][:, None] + np.array([0.0, pi])).ravel()  # off the wall on either side
    return _spots(grid, grid.centres(cells).repeat(2, axis=0), towards_rad)


def _spots(grid: GridMap, walls: Points, towards_rad: FloatArray) -> dict[Cell, float]:
    """The best cells to stand on and see those places on walls (N, 2), (N,) being the directions off the wall."""
    left = np.arange(len(walls))  # those without a spot
    chosen = np.full((len(walls), 2), -1)
    off = np.stack([np.cos(towards_rad), np.sin(towards_rad)], axis=1)
    for distance_m in DISTANCES_M:
        places = walls[left] + distance_m * off[left]
        good = grid.stands_each(places)
        good[good] = _sees_walls(grid, places[good], walls[left][good])
        chosen[left[good]] = grid.cells_of(places[good])
        left = left[~good]
    found = chosen[:, 0] >= 0
    headings_rad = wrap_angles(towards_rad[found] - pi / 2)
    return {(r, c): rad for (r, c), rad in zip(chosen[found].tolist(), headings_rad.tolist(), strict=True)}


def _unseen(grid: GridMap, seen: SeenWalls, normals_rad: FloatArray) -> Mask:
    unseen = ~np.isnan(normals_rad) & (box_sum(seen.on(grid).astype(np.float64), 1) < 0.5)
    mask: Mask = unseen & (box_sum(unseen.astype(np.float64), UNSEEN_REACH_CELLS) > UNSEEN_CELLS_MIN - 0.5)
    return mask


def _add(seen: SeenWalls, grid: GridMap, pose: Pose2) -> None:
    near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
    seen.add(near, _seen_well(near, pose))


def beginning(spots: dict[Cell, float], grid: GridMap, near: Cell) -> Cell:
    """Where the stretch of wall that one of the spots shows begins: the rearmost of its spots, by the heading there."""
    heading_rad = spots[near]
    cells = np.array([spot for spot, rad in spots.items() if abs(wrap_angle(rad - heading_rad)) < SAME_WALL_RAD])
    d = grid.centres(cells) - np.array(grid.centre(near))
    along = d[:, 0] * cos(heading_rad) + d[:, 1] * sin(heading_rad)
    aside = np.abs(-d[:, 0] * sin(heading_rad) + d[:, 1] * cos(heading_rad))
    behind = np.flatnonzero((along <= 0.0) & (aside < SAME_WALL_M))
    first = behind[np.argsort(-along[behind])]
    gaps = np.diff(-along[first], prepend=0.0) > SAME_WALL_M
    last = first[: int(gaps.argmax())] if gaps.any() else first
    row, column = cells[last[-1]].tolist()
    return row, column


def wall_normals(grid: GridMap) -> FloatArray:
    """Direction of the normal (rows, columns), radians in [0, pi), of the cells of straight wall; NaN elsewhere."""
    normals: FloatArray = np.full(grid.cells.shape, np.nan)
    cells = np.argwhere(grid.cells == WALL)
    normals[tuple(cells.T)] = _normals_at(grid, cells)
    return normals


def _normals_at(grid: GridMap, cells: Cells) -> FloatArray:
    """Of wall cells (N, 2): the minor axis (N,) of the second moments of the wall cells around each; NaN at a blot."""
    if not len(cells):  # the grid may be smaller than the window
        return np.empty(0)
    walls = np.pad(grid.cells == WALL, LINE_REACH_CELLS).astype(np.float32)
    side = 2 * LINE_REACH_CELLS + 1
    around = sliding_window_view(walls, (side, side))[tuple(cells.T)].reshape(len(cells), side * side)
    n, x, y, xx, yy, xy = (around @ _MOMENTS).T.astype(np.float64)
    x, y = x / n, y / n
    xx, yy, xy = xx / n - x**2, yy / n - y**2, xy / n - x * y
    line_share = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-9)
    straight = (n >= LINE_CELLS_MIN) & (line_share > LINE_SHARE)
    normals: FloatArray = np.where(straight, (np.arctan2(2 * xy, xx - yy) / 2 + pi / 2) % pi, np.nan)
    return normals


def _moments() -> npt.NDArray[np.float32]:
    """Of each cell around one: 1, x, y, and their products (cells, 6)."""
    offset = np.arange(-LINE_REACH_CELLS, LINE_REACH_CELLS + 1, dtype=np.float32)
    y, x = (axis.ravel() for axis in np.meshgrid(offset, offset, indexing="ij"))
    return np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1)


_MOMENTS = _moments()


def box_sum(values: FloatArray, reach: int) -> FloatArray:
    """Sum (rows, columns) over the square of cells up to `reach` away (a summed-area table: Crow 1984)."""
    total = np.pad(values, ((reach + 1, reach), (reach + 1, reach))).cumsum(axis=0).cumsum(axis=1)
    side = 2 * reach + 1
    sums: FloatArray = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    return sums


def _offset(grid: GridMap) -> Cell:
    """Of the grid's first cell, in cells from the origin of the map."""
    return round(grid.origin_y_m / grid.cell_m), round(grid.origin_x_m / grid.cell_m)


def _in_view(grid: GridMap, pose: Pose2) -> tuple[Cells, Points, FloatArray]:
    """Wall cells (N, 2) in the field of view, their centres (N, 2) and the directions (N,) they are seen in."""
    cells = np.argwhere(grid.cells == WALL)
    points = grid.centres(cells)
    d = points - np.array([pose.x_m, pose.y_m])
    view_rad = np.arctan2(d[:, 1], d[:, 0])
    aside = np.abs(wrap_angles(view_rad - (pose.heading_rad - pi / 2)))
    keep = (np.hypot(d[:, 0], d[:, 1]) <= CAMERA_RANGE_M) & (aside <= CAMERA_FIELD_OF_VIEW_RAD / 2)
    return cells[keep], points[keep], view_rad[keep]


def _seen_well(grid: GridMap, pose: Pose2) -> Cells:
    """Those of them that are not seen at too flat a slant, nor hidden by another wall."""
    cells, points, view_rad = _in_view(grid, pose)
    normal_rad = _normals_at(grid, cells)
    slant_rad = np.abs((view_rad - normal_rad + pi / 2) % pi - pi / 2)
    square = np.isnan(normal_rad) | (slant_rad < CAMERA_INCIDENCE_MAX_RAD)
    cells, points = cells[square], points[square]
    seen: Cells = cells[_sees_walls(grid, np.array([pose.x_m, pose.y_m]), points)]
    return seen


def _sees_walls(grid: GridMap, here: Points, walls: Points) -> Mask:
    """No other wall (N,) in front of places on walls (N, 2), seen from (N, 2), or (2,) for all of them."""
    d = walls - here
    distance_m = np.hypot(d[:, 0], d[:, 1])[:, None]
    ends = here + np.maximum(1.0 - SIGHT_GAP_M / np.maximum(distance_m, 1e-9), 0.0) * d
    clear: Mask = (distance_m[:, 0] <= SIGHT_GAP_M) | grid.sees_each(here, ends)
    return clear
