"""The map as it is published: occupancy grid and wall points, drawn when they are wanted, a part at a time."""

from __future__ import annotations

import numpy as np

from onboard.mmu.map.drawing import draw
from onboard.mmu.map.keyframe_map import Counts, KeyframeMap
from onboard.mmu.map.keyframes import in_map
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints, WallStore

# What is drawn at once at most: a step must stay short. One ray costs nearly as much as ten
DRAW_RAYS = 40
DRAW_ECHOES = 1000
PLACE_ECHOES = 4000


class DrawnMap:
    """`revision` grows whenever wall points that were published are replaced."""

    def __init__(self, keyframes: KeyframeMap) -> None:
        self._keyframes = keyframes
        self.grid = OccupancyGrid()
        self.revision = 0
        self._walls = WallStore()
        self._placed = 0  # echoes among the wall points
        self._drawn = Counts()  # echoes and rays in the grid

    def keep_up(self) -> None:
        """To be called in every step: draws where so much waits that it takes several steps."""
        echoes, rays = len(self._keyframes.echoes), len(self._keyframes.rays)
        if echoes - self._drawn.echoes >= DRAW_ECHOES or rays - self._drawn.rays >= DRAW_RAYS:
            self.draw_newest()

    def draw_newest(self) -> None:
        """Bring the grid up to the newest echoes and rays, or nearer to them where many are left."""
        drawn = self._drawn
        echoes = self._keyframes.echoes.rows(drawn.echoes, drawn.echoes + DRAW_ECHOES)
        rays = self._keyframes.rays.rows(drawn.rays, drawn.rays + DRAW_RAYS)
        draw(self.grid, echoes, rays, self._keyframes.poses.array)
        self._drawn = Counts(0, drawn.echoes + len(echoes), drawn.rays + len(rays))

    def replace(self, grid: OccupancyGrid | None, walls: WallPoints | None, of: Counts) -> None:
        """Grid and wall points, where they are given, were drawn again from so many observations."""
        if grid is not None:
            self.grid, self._drawn = grid, of
        if walls is not None:
            self._walls.replace(walls)
            self._placed = of.echoes
            self.revision += 1

    def wall_points(self, start: int) -> WallPoints:
        """From the `start`-th on; those of a revision lie where they lay when they were placed."""
        rows = self._keyframes.echoes.rows(self._placed, self._placed + PLACE_ECHOES)
        self._walls.append(WallPoints.of(in_map(rows, self._keyframes.poses.array)[0], np.zeros((0, 2))))
        self._placed += len(rows)
        return self._walls.since(start)

    @property
    def wall_count(self) -> int:
        """How many wall points there are, with those that `wall_points` has not placed yet."""
        return len(self._walls) + len(self._keyframes.echoes) - self._placed
