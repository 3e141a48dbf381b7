"""Which walls the camera has seen, and where to drive along those that it has not.

The camera looks to the right, so a hall that was driven one way shows one of its walls. What a drive has shown is kept
as cells of the map; the rest of the walls on the grid gives spots to stand on with a heading, the wall on the right.
(The coverage part of view planning: Scott, Roth & Rivest 2003, "View planning for automated three-dimensional object
reconstruction and inspection", here with one look per cell of wall.)
"""

from __future__ import annotations

from collections import deque
from math import cos, hypot, pi, radians, sin

import numpy as np
import numpy.typing as npt

from common.constants import CAMERA_FIELD_OF_VIEW_RAD, CAMERA_INCIDENCE_MAX_RAD, CAMERA_RANGE_M
from common.geometry import FloatArray, Points, Pose2, wrap_angle, wrap_angles
from common.grid_cells import WALL
from onboard.planner.exploration.frontiers import Cells, considered
from onboard.planner.grid.grid_map import Cell, GridMap, Mask
from onboard.planner.grid.grid_reading import tiles
from onboard.planner.grid.sliced_work import Work

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
CELLS_JUDGED_PER_US = 5
SPOT_US = 100
_KEY_ROWS = 1 << 20

Keys = npt.NDArray[np.int64]  # (N,) cells of the map, whatever part of it a grid shows


class WallImaging:
    """What was seen so far. `look` takes in where the robot is; the rest are queries."""

    def __init__(self) -> None:
        self._seen: Keys = np.zeros(0, dtype=np.int64)
        self._recent: deque[Pose2] = deque(maxlen=RECENT_LOOKS)
        self._last: Pose2 | None = None

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
            self._add(grid, self._recent[0])
        self._recent.append(pose)
        self._add(grid, pose)

    def settle(self, grid: GridMap, pose: Pose2) -> None:
        """Counts all walls in view from here as seen, even at a bad angle: they are not visited again."""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        self._keep(near, _in_view(near, pose)[0])

    def shows_new(self, grid: GridMap, pose: Pose2) -> bool:
        """Is there an unseen wall in the field of view of a robot that stands like that?"""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        return bool(self.unseen(near)[tuple(_seen_well(near, pose).T)].any())

    def unseen(self, grid: GridMap) -> Mask:
        """Cells (rows, columns) of walls that nobody has looked at; corners and blots do not count."""
        return self._unseen(grid, wall_normals(grid))

    def spots(self, grid: GridMap, here: Pose2) -> Work[dict[Cell, float]]:
        """Where to stand to see what is unseen, and the heading there, radians in the map; `here` is the robot."""
        for pose in self._recent:
            self._add(grid, pose)
        normals_rad, unseen = np.zeros(grid.cells.shape), np.zeros(grid.cells.shape, dtype=bool)
        for tile, around, inside in tiles(grid.cells.shape, TILE_CELLS, HALO_CELLS):
            part, first = grid.part(around), (around[0].start, around[1].start)
            normals = wall_normals(part, first)
            normals_rad[tile], unseen[tile] = normals[inside], self._unseen(part, normals)[inside]
            yield part.cells.size // CELLS_JUDGED_PER_US
        found: dict[Cell, float] = {}
        for row, column in considered(grid, unseen, here).tolist():
            yield SPOT_US
            wall, normal_rad = grid.centre((row, column)), float(normals_rad[row, column])
            for towards_rad in (normal_rad, normal_rad + pi):
                spot = _spot(grid, wall, towards_rad)
                if spot is not None:
                    found[spot] = wrap_angle(towards_rad - pi / 2)
        return found

    def worth_going_on(self, grid: GridMap, pose: Pose2, heading_rad: float) -> bool:
        """Will driving on along this heading show an unseen wall on the right before long?"""
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        cells = np.argwhere(self.unseen(near))
        c, s = cos(heading_rad), sin(heading_rad)
        d = near.centres(cells) - np.array([pose.x_m, pose.y_m])
        along, right = d[:, 0] * c + d[:, 1] * s, d[:, 0] * s - d[:, 1] * c
        ahead = (along > AHEAD_M[0]) & (along < AHEAD_M[1]) & (right > 0.0) & (right < CAMERA_RANGE_M)
        for along_m, right_m in zip(along[ahead].tolist(), right[ahead].tolist(), strict=True):
            beside = (pose.x_m + along_m * c, pose.y_m + along_m * s)
            if _sees_wall(near, beside, (beside[0] + right_m * s, beside[1] - right_m * c)):
                return True
        return False

    def _unseen(self, grid: GridMap, normals_rad: FloatArray) -> Mask:
        rows, columns = np.divmod(self._seen, _KEY_ROWS)
        row0, column0 = _offset(grid)
        rows, columns = rows - row0, columns - column0
        inside = (rows >= 0) & (rows < grid.cells.shape[0]) & (columns >= 0) & (columns < grid.cells.shape[1])
        seen = np.zeros(grid.cells.shape)
        seen[rows[inside], columns[inside]] = 1.0
        unseen = ~np.isnan(normals_rad) & (box_sum(seen, 1) < 0.5)
        mask: Mask = unseen & (box_sum(unseen.astype(np.float64), UNSEEN_REACH_CELLS) > UNSEEN_CELLS_MIN - 0.5)
        return mask

    def _add(self, grid: GridMap, pose: Pose2) -> None:
        near = grid.window(pose.x_m, pose.y_m, CAMERA_RANGE_M)
        self._keep(near, _seen_well(near, pose))

    def _keep(self, grid: GridMap, cells: Cells) -> None:
        row0, column0 = _offset(grid)
        self._seen = np.union1d(self._seen, (cells[:, 0] + row0) * _KEY_ROWS + cells[:, 1] + column0)


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


def wall_normals(grid: GridMap, first: Cell = (0, 0)) -> FloatArray:
    """Direction of the normal (rows, columns), radians in [0, pi), of the cells of straight wall; NaN elsewhere.

    The minor axis of the second moments of the wall cells around each. `first`: where the grid begins in a larger one.
    """
    walls = (grid.cells == WALL).astype(np.float64)
    rows, columns = (np.arange(count, dtype=np.float64) + at for count, at in zip(walls.shape, first, strict=True))
    rows = rows[:, None]
    n = np.maximum(box_sum(walls, LINE_REACH_CELLS), 1.0)
    x, y = box_sum(walls * columns, LINE_REACH_CELLS) / n, box_sum(walls * rows, LINE_REACH_CELLS) / n
    xx = box_sum(walls * columns**2, LINE_REACH_CELLS) / n - x**2
    yy = box_sum(walls * rows**2, LINE_REACH_CELLS) / n - y**2
    xy = box_sum(walls * rows * columns, LINE_REACH_CELLS) / n - x * y
    line_share = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-9)
    straight = (walls > 0.0) & (n >= LINE_CELLS_MIN) & (line_share > LINE_SHARE)
    normals: FloatArray = np.where(straight, (np.arctan2(2 * xy, xx - yy) / 2 + pi / 2) % pi, np.nan)
    return normals


def box_sum(values: FloatArray, reach: int) -> FloatArray:
    """Sum (rows, columns) over the square of cells up to `reach` away (a summed-area table: Crow 1984)."""
    total = np.pad(values, ((reach + 1, reach), (reach + 1, reach))).cumsum(axis=0).cumsum(axis=1)
    side = 2 * reach + 1
    sums: FloatArray = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    return sums


def _offset(grid: GridMap) -> Cell:
    """Of the grid's first cell, in cells from the origin of the map."""
    half = _KEY_ROWS // 2
    return round(grid.origin_y_m / grid.cell_m) + half, round(grid.origin_x_m / grid.cell_m) + half


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
    normal_rad = wall_normals(grid)[tuple(cells.T)]
    slant_rad = np.abs((view_rad - normal_rad + pi / 2) % pi - pi / 2)
    square = np.isnan(normal_rad) | (slant_rad < CAMERA_INCIDENCE_MAX_RAD)
    here = (pose.x_m, pose.y_m)
    clear = [i for i in np.flatnonzero(square).tolist() if _sees_wall(grid, here, tuple(points[i].tolist()))]
    return cells[clear]


def _sees_wall(grid: GridMap, here: tuple[float, float], wall: tuple[float, float]) -> bool:
    """No other wall in front of a place on a wall."""
    distance_m = hypot(wall[0] - here[0], wall[1] - here[1])
    if distance_m <= SIGHT_GAP_M:
        return True
    f = 1.0 - SIGHT_GAP_M / distance_m
    return grid.sees(here, (here[0] + f * (wall[0] - here[0]), here[1] + f * (wall[1] - here[1])))


def _spot(grid: GridMap, wall: tuple[float, float], towards_rad: float) -> Cell | None:
    """The best cell to stand on and see that place on a wall, `towards_rad` being the direction off the wall."""
    for distance_m in DISTANCES_M:
        x_m, y_m = wall[0] + distance_m * cos(towards_rad), wall[1] + distance_m * sin(towards_rad)
        if grid.stands(x_m, y_m) and _sees_wall(grid, (x_m, y_m), wall):
            return grid.cell(x_m, y_m)
    return None
