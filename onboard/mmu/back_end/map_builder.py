"""One round of the work beside the steps: back end, grid and walls drawn again when the past moved, map on disk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from common.geometry import FloatArray
from common.side_work import DeferredWorker
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.map.drawing import draw
from onboard.mmu.map.keyframes import Keyframe, ObservationStore, in_map
from onboard.mmu.map.map_file import SAVE_EVERY_S, SavedMap, try_save
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints
from onboard.mmu.map.wall_segments import Rays, inferred_points

# The sensitivity was not measured
LATENCY_S = 0.4  # of the messages' clock: stands for the time that the back end takes
REDRAW_M = 0.05  # half a cell: a correction larger than this redraws grid and walls
REDRAW_PATH_M = 10.0  # after so much path the walls are drawn again in any case


class MapBuilder:
    """Collects what it is given; `map_file` None saves nothing."""

    def __init__(self, map_file: Path | None = None, gyro_led: bool = True) -> None:
        self._back_end = BackEnd(gyro_led)
        self._file = map_file
        self._keyframes: list[Keyframe] = []
        self._rays = ObservationStore()
        self._drawn: FloatArray = np.zeros((0, 3))  # poses that the grid was drawn with
        self._drawn_path_m = 0.0  # path at which the walls were drawn
        self._saved = (float("-inf"), 0)  # when, and how many closures there were
        self._last: tuple[Increment, Correction] | None = None

    def correction(self, increment: Increment) -> Correction:
        """One round, and the map on disk where that is due."""
        correction = self.take(increment)
        self._save()
        return correction

    def take(self, increment: Increment) -> Correction:
        """The back end's correction, with new grid and walls where the old ones are too far off."""
        self._keyframes.extend(increment.keyframes)
        self._rays.append(increment.rays)
        correction = self._back_end.take(increment)
        moved = correction.poses[: len(self._drawn), :2] - self._drawn[:, :2]
        off = bool(len(moved)) and float(np.hypot(moved[:, 0], moved[:, 1]).max()) > REDRAW_M
        if off:
            correction = replace(correction, grid=self._draw_grid(correction.poses))
            self._drawn = correction.poses
        else:
            self._drawn = np.concatenate([self._drawn, correction.poses[len(self._drawn) :]])
        path_m = self._keyframes[-1].path_m if self._keyframes else 0.0
        if off or path_m - self._drawn_path_m >= REDRAW_PATH_M:
            correction = replace(correction, walls=self._draw_walls(correction.poses))
            self._drawn_path_m = path_m
        self._last = (increment, correction)
        return correction

    def _draw_grid(self, poses: FloatArray) -> OccupancyGrid:
        grid = OccupancyGrid()
        draw(grid, self._back_end.echoes.rows(), self._rays.rows(), poses)
        return grid

    def _draw_walls(self, poses: FloatArray) -> WallPoints:
        rays = self._rays.rows()
        echoed, normals = in_map(self._back_end.echoes.rows(), poses)
        starts, directions = in_map(rays, poses)
        return WallPoints.of(echoed, inferred_points(echoed, normals, Rays(starts, directions, rays[:, 5])))

    def _save(self) -> None:
        """The map on disk, at every closure and every 30 s."""
        if self._file is None or self._last is None or not self._keyframes:
            return
        increment, correction = self._last
        now_s = self._keyframes[-1].t_s
        if correction.closures == self._saved[1] and now_s - self._saved[0] < SAVE_EVERY_S:
            return
        self._saved = now_s, correction.closures
        times_s = np.array([keyframe.t_s for keyframe in self._keyframes])
        paths_m = np.array([keyframe.path_m for keyframe in self._keyframes])
        rows = self._back_end.echoes.rows(), self._rays.rows()
        try_save(self._file, SavedMap(times_s, correction.poses, paths_m, *rows, increment.last))


def deferred_back_end(
    map_file: Path | None = None, latency_s: float = LATENCY_S, gyro_led: bool = True
) -> DeferredWorker[Increment, Correction]:
    """The back end in this very process, for lockstep and replay."""
    return DeferredWorker(lambda: MapBuilder(map_file, gyro_led).correction, latency_s)
