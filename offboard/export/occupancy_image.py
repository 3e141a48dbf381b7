"""A run as an occupancy image in the format of ROS map servers: run folder and database -> `map.pgm` and `map.yaml`.

Free is where the robot drove and where its sonars looked through; occupied are the wall points; the rest is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from common import grid_cells
from common.constants import FOOTPRINT_RADIUS_M, SONAR_BEARINGS_RAD
from common.geometry import FloatArray, Points
from common.messages.topics import RANGES
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import (
    DATABASE_NAME,
    read_map,
    read_path,
)

CELL_M = 0.05
MARGIN_M = 1.0
SIGHT_END_M = 0.15  # the last bit of a beam lies in the wall
SIGHT_MAX_M = 4.0  # a beam is a cone: farther away it is wider than the line that it would mark as free
PASSED_MIN = 5  # beams through a cell before it counts as free: single ones have been mirrored by a wall
OCCUPIED, FREE, UNKNOWN = 0, 254, 205
# 205 is read as (255 - 205) / 255 = 0.19608: a larger threshold would make all that is unknown free
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65


@dataclass(frozen=True, slots=True)
class OccupancyImage:
    """Cells (rows, columns) of OCCUPIED, FREE or UNKNOWN, row 0 at the top; the lower left corner is the origin."""

    cells: npt.NDArray[np.uint8]
    origin_x_m: float
    origin_y_m: float

    def pgm(self) -> bytes:
        """A binary PGM file (P5)."""
        rows, columns = self.cells.shape
        return b"".join((f"P5\n{columns} {rows}\n255\n".encode(), self.cells.data))

    def grid_cells(self) -> npt.NDArray[np.uint8]:
        """The cells as the robot's own grid has them (`common/grid_cells.py`), row 0 at the lowest y."""
        cells = np.full(self.cells.shape, grid_cells.UNKNOWN, np.uint8)
        cells[self.cells == FREE], cells[self.cells == OCCUPIED] = grid_cells.FREE, grid_cells.WALL
        return cells[::-1]

    def yaml(self, image_name: str) -> str:
        """What a ROS map server reads beside the image."""
        return (
            f"image: {image_name}\nmode: trinary\nresolution: {CELL_M}\n"
            f"origin: [{self.origin_x_m:.3f}, {self.origin_y_m:.3f}, 0.0]\nnegate: 0\n"
            f"occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
        )


def sightlines(times_s: FloatArray, poses: FloatArray, ranges_s: FloatArray, ranges_m: FloatArray) -> Points:
    """Points (N, 2) that the beams passed: ranges (M, 5) at times (M,), poses (K, 3) at times (K,)."""
    if len(times_s) < 2 or not len(ranges_s):
        return np.empty((0, 2))
    during = (ranges_s >= times_s[0]) & (ranges_s <= times_s[-1])
    ranges_s, ranges_m = ranges_s[during], ranges_m[during]
    x_m, y_m = (np.interp(ranges_s, times_s, poses[:, k]) for k in (0, 1))
    heading_rad = np.interp(ranges_s, times_s, np.unwrap(poses[:, 2]))
    steps_m = np.arange(0.0, SIGHT_MAX_M, CELL_M)
    points = []
    for k, bearing_rad in enumerate(SONAR_BEARINGS_RAD):
        clear_m = ranges_m[:, k] - SIGHT_END_M
        passed = steps_m[None, :] < np.nan_to_num(clear_m, nan=0.0)[:, None]
        beam, step = np.nonzero(passed)
        angle_rad = heading_rad[beam] + bearing_rad
        reach_m = steps_m[step]
        points.append(
            np.column_stack([x_m[beam] + reach_m * np.cos(angle_rad), y_m[beam] + reach_m * np.sin(angle_rad)])
        )
    return np.concatenate(points)


def occupancy_image(walls_m: Points, driven_m: Points, seen_m: Points) -> OccupancyImage:
    """Wall points win over what was driven or looked through; all (N, 2)."""
    everything = np.concatenate([walls_m, driven_m, np.zeros((1, 2))])
    # As `map.yaml` has it, so that a point on the border of two cells falls into the same one for whoever reads it
    low = np.round(np.floor((everything.min(axis=0) - MARGIN_M) / CELL_M) * CELL_M, 3)
    size = np.ceil((everything.max(axis=0) + MARGIN_M - low) / CELL_M).astype(int)
    cells = np.full((size[1], size[0]), UNKNOWN, np.uint8)
    reach = np.arange(-FOOTPRINT_RADIUS_M, FOOTPRINT_RADIUS_M + 1e-9, CELL_M)
    disc = np.array([(x, y) for x in reach for y in reach if x * x + y * y <= FOOTPRINT_RADIUS_M**2])
    footprint_m = (driven_m[:, None, :] + disc[None, :, :]).reshape(-1, 2)
    for points_m, value, needed in ((seen_m, FREE, PASSED_MIN), (footprint_m, FREE, 1), (walls_m, OCCUPIED, 1)):
        column, row = np.floor((points_m - low) / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < size[0]) & (row < size[1])
        # Counted by the cells that are met, so that memory grows with the points and not with the map
        place, count = np.unique((size[1] - 1 - row[inside]) * size[0] + column[inside], return_counts=True)
        cells.flat[place[count >= needed]] = value
    return OccupancyImage(cells, float(low[0]), float(low[1]))


def image_of_run(run_dir: Path) -> OccupancyImage:
    """From the files of the folder, and the ranges where there is a database."""
    data = read_map(run_dir)
    times_s, poses = read_path(run_dir)
    ranges_s, ranges_m = np.empty(0), np.empty((0, len(SONAR_BEARINGS_RAD)))
    if (run_dir / DATABASE_NAME).exists():
        with RunReader(run_dir) as run:
            readings = [m.payload for m in run.messages(RANGES) if m.payload.valid]
        rows = [(r.t_s, *r.range_m) for r in readings if len(r.range_m) == len(SONAR_BEARINGS_RAD)]
        table = np.array(rows, dtype=np.float64).reshape(-1, 1 + len(SONAR_BEARINGS_RAD))
        ranges_s, ranges_m = table[:, 0], table[:, 1:]
    return occupancy_image(data.points_m, poses[:, :2], sightlines(times_s, poses, ranges_s, ranges_m))
