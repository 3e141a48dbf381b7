"""One round of what happens beside the steps: back end, grid and walls drawn anew when the past moved, map on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.map.keyframes import Correction, FrameStore, Increment, KeyFrame, in_map
from onboard.mmu.map.map_file import SAVE_EVERY_S, SavedMap, try_save
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints
from onboard.mmu.map.wall_segments import Rays, concluded

REDRAW_M = 0.05  # half a cell: a correction larger than this redraws grid and walls
REDRAW_WAY_M = 10.0  # after so much way the walls are drawn anew all the same


class Rounds:
    """Collects what it is given; `map_file` None saves nothing."""

    def __init__(self, map_file: Path | None = None, gyro_led: bool = True) -> None:
        self._back_end = BackEnd(gyro_led)
        self._file = map_file
        self._frames: list[KeyFrame] = []
        self._rays = FrameStore()
        self._drawn: FloatArray = np.zeros((0, 3))  # poses that the grid was drawn with
        self._drawn_way_m = 0.0  # way at which the walls were drawn
        self._saved = (float("-inf"), 0)  # when, and how many closures there were
        self._last: tuple[Increment, Correction] | None = None

    def take(self, increment: Increment) -> Correction:
        """The back end's correction, with new grid and walls where the old ones are too far off."""
        self._frames.extend(increment.frames)
        self._rays.append(increment.rays)
        correction = self._back_end.take(increment)
        moved = correction.poses[: len(self._drawn), :2] - self._drawn[:, :2]
        off = bool(len(moved)) and float(np.hypot(moved[:, 0], moved[:, 1]).max()) > REDRAW_M
        if off:
            correction = replace(correction, grid=self._draw_grid(correction.poses))
            self._drawn = correction.poses
        else:
            self._drawn = np.concatenate([self._drawn, correction.poses[len(self._drawn) :]])
        way_m = self._frames[-1].way_m if self._frames else 0.0
        if off or way_m - self._drawn_way_m >= REDRAW_WAY_M:
            correction = replace(correction, walls=self._draw_walls(correction.poses))
            self._drawn_way_m = way_m
        self._last = (increment, correction)
        return correction

    def _draw_grid(self, poses: FloatArray) -> OccupancyGrid:
        grid = OccupancyGrid()
        echoes, rays = self._back_end.echoes.rows(), self._rays.rows()
        if len(echoes):
            grid.add_walls(*in_map(echoes, poses))
        if len(rays):
            starts, directions = in_map(rays, poses)
            grid.add_rays(starts, directions, rays[:, 5])
            grid.add_footprint(starts)
        return grid

    def _draw_walls(self, poses: FloatArray) -> WallPoints:
        rays = self._rays.rows()
        echoed, normals = in_map(self._back_end.echoes.rows(), poses)
        starts, directions = in_map(rays, poses)
        return WallPoints.of(echoed, concluded(echoed, normals, Rays(starts, directions, rays[:, 5])))

    def save(self) -> None:
        """The map on disk, at every closure and every 30 s."""
        if self._file is None or self._last is None or not self._frames:
            return
        increment, correction = self._last
        now_s = self._frames[-1].t_s
        if correction.closures == self._saved[1] and now_s - self._saved[0] < SAVE_EVERY_S:
            return
        self._saved = now_s, correction.closures
        times_s = np.array([f.t_s for f in self._frames])
        ways_m = np.array([f.way_m for f in self._frames])
        rows = self._back_end.echoes.rows(), self._rays.rows()
        try_save(self._file, SavedMap(times_s, correction.poses, ways_m, *rows, increment.last))
