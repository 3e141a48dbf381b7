"""What exploration asks (`grid.deliberation`): a grid read and judged, a path, spots to see walls from."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from common.geometry import Pose2
from common.messages import GridUpdate
from onboard.planner.exploration.frontiers import Frontier, FrontierGroup, groups, worth_a_visit
from onboard.planner.exploration.recovery_memory import Places, blocked_cells
from onboard.planner.exploration.wall_imaging import Imaged, spots
from onboard.planner.grid.deliberation import Grids
from onboard.planner.grid.grid_map import Cell, GridMap
from onboard.planner.grid.grid_reading import GridError, read
from onboard.planner.routing.path_following import Path
from onboard.planner.routing.route_planning import cheapest_path


@dataclass(frozen=True, slots=True)
class JudgedGrid:
    """What a grid offers to a robot that leaves out what its query left out. `changes` is the query's.

    `grid` is None where the query was about one that its sender has.
    """

    revision: int
    frontier: Frontier
    groups: list[FrontierGroup]
    changes: int
    grid: GridMap | None = None


@dataclass(frozen=True, slots=True)
class JudgeGrid:
    """What is on the list? `left_out` of the frontier, `obstacles` on the floor; `changes`: which version of both.

    `update` is the grid itself where that is new. The answer is a JudgedGrid, or a GridError where the update is none.
    """

    revision: int
    pose: Pose2
    left_out: Places
    obstacles: Places
    changes: int
    update: GridUpdate | None = None

    def answer(self, grids: Grids) -> JudgedGrid | GridError:
        new = None
        if self.update is not None:
            try:
                new = read(self.update)
            except GridError as error:
                return error
            grids.put(self.revision, new)
        grid = grids.of(self.revision)
        frontier = worth_a_visit(grid, blocked_cells(grid, self.obstacles), self.pose, self.left_out)
        return JudgedGrid(self.revision, frontier, groups(frontier), self.changes, new)


@dataclass(frozen=True, slots=True)
class FindPath:
    """Which path leads to the cheapest of the wanted cells of that grid? The answer is None where none does."""

    revision: int
    pose: Pose2
    wanted: Collection[Cell]
    obstacles: Places

    def answer(self, grids: Grids) -> Path | None:
        grid = grids.of(self.revision)
        return cheapest_path(grid, self.pose, self.wanted, blocked_cells(grid, self.obstacles))


@dataclass(frozen=True, slots=True)
class FindSpots:
    """Where can walls be seen that were not yet? `imaged`: what was. The answer as of `spots`."""

    revision: int
    pose: Pose2
    imaged: Imaged

    def answer(self, grids: Grids) -> dict[Cell, float]:
        return spots(grids.of(self.revision), self.imaged, self.pose)
