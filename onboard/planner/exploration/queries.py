"""What exploration asks (`grid.deliberation`): a grid read and judged, a tour, a path, spots to see walls from."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from common.geometry import Points, Pose2
from common.messages.mapping import GridUpdate
from common.zones import Zone
from onboard.planner.exploration.frontiers import Frontier, FrontierGroup, groups, together, worth_a_visit
from onboard.planner.exploration.recovery_memory import Places, blocked_cells
from onboard.planner.exploration.unknown_floor import UnknownFloor
from onboard.planner.exploration.wall_imaging import Imaged, spots
from onboard.planner.grid.deliberation import Grids
from onboard.planner.grid.grid_map import Cell, GridMap, Mask
from onboard.planner.grid.grid_reading import GridError, without_zones
from onboard.planner.routing.destination import nearest_cells
from onboard.planner.routing.path_following import Path
from onboard.planner.routing.reachable import reachable
from onboard.planner.routing.route_planning import cell_prices, cheapest_path
from onboard.planner.routing.tour import PLACES_MAX, tours_m
from onboard.planner.routing.walking_distances import WalkingDistances
from onboard.planner.zones.zone_cells import NO_GO

FAR_M = 1e4  # stands for a way home that is not known


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
    """What is on the list? `left_out` of the frontier, `obstacles` on the floor, `changes`: which version of both;
    the `trail` (N, 2) that the robot drove.

    `update`, with what `zones` keep the robot out of, is the grid itself where that is new. The
    answer is a JudgedGrid, or a GridError where the update is none.
    """

    revision: int
    pose: Pose2
    left_out: Places
    obstacles: Places
    trail: Points
    changes: int
    update: GridUpdate | None = None
    zones: tuple[Zone, ...] = ()

    def answer(self, grids: Grids) -> JudgedGrid | GridError:
        new = None
        if self.update is not None:
            try:
                new = grids.reader.read(self.update, self.zones)
            except GridError as error:
                return error
            grids.put(self.revision, new)
        grid = grids.of(self.revision)
        grids.recent.turn()
        out_of_reach = ~_reachable(grid, self.pose) | blocked_cells(grid, self.obstacles)
        frontier = worth_a_visit(grid, out_of_reach, self.pose, self.left_out)
        listed = groups(frontier, UnknownFloor(grid, self.trail, grids.recent))
        return JudgedGrid(self.revision, together(listed), listed, self.changes, new)


def _reachable(grid: GridMap, pose: Pose2) -> Mask:
    """Cells (rows, columns): a ray that passed where no wall had echoed yet shows floor outside the building."""
    here = grid.cell(pose.x_m, pose.y_m)
    if not grid.contains(here):
        return np.ones(grid.cells.shape, dtype=bool)
    return reachable(cell_prices(grid, here), here)


@dataclass(frozen=True, slots=True)
class JudgeLeftOut:
    """What would still be to be seen if nothing were deferred, in the way, or kept out by zones?

    The answer has the entries, each with whether it is zones alone that keep the robot from it.
    """

    revision: int
    pose: Pose2
    trail: Points

    def answer(self, grids: Grids) -> list[tuple[FrontierGroup, bool]]:
        grid = grids.of(self.revision)
        bare = without_zones(grid)
        open_to_all = _reachable(bare, self.pose)
        frontier = worth_a_visit(bare, ~open_to_all, self.pose)
        reached = open_to_all if bare is grid else _reachable(grid, self.pose)
        listed = groups(frontier, UnknownFloor(bare, self.trail))
        return [(group, not reached[tuple(group.cells.T)].any()) for group in listed]


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
class FindPathBefore:
    """Which path leads to where it can stand nearest to a place in a wall? The answer is None where none does."""

    revision: int
    pose: Pose2
    place_m: tuple[float, float]
    obstacles: Places

    def answer(self, grids: Grids) -> Path | None:
        grid = grids.of(self.revision)
        wanted = nearest_cells(grid, self.place_m, _reachable(grid, self.pose))
        return cheapest_path(grid, self.pose, wanted, blocked_cells(grid, self.obstacles)) if wanted else None


@dataclass(frozen=True, slots=True)
class IsKeptOut:
    """Do zones alone keep the robot from all of the wanted cells? No while it stands where they forbid it to."""

    revision: int
    pose: Pose2
    wanted: Collection[Cell]

    def answer(self, grids: Grids) -> bool:
        grid = grids.of(self.revision)
        bare = without_zones(grid)
        here = grid.cell(self.pose.x_m, self.pose.y_m)
        if bare is grid or not grid.contains(here) or grid.cells[here] & NO_GO:
            return False
        known = tuple(np.array([cell for cell in self.wanted if grid.contains(cell)], dtype=int).reshape(-1, 2).T)
        return bool(_reachable(bare, self.pose)[known].any() and not _reachable(grid, self.pose)[known].any())


@dataclass(frozen=True, slots=True)
class Offer:
    """An entry of the list by its number: how far it is, how much further the way home is past it, and how long the
    shortest way home past all entries is that begins with it (metres)."""

    entry: int
    distance_m: float
    detour_m: float
    tour_m: float


@dataclass(frozen=True, slots=True)
class PlanTours:
    """What does it cost to begin with each entry of the list? `entries` are cells, `home` is where the robot ends.

    The answer has those that can be reached, the nearest first, and of many only the nearest.
    """

    revision: int
    pose: Pose2
    entries: tuple[Cell, ...]
    home: tuple[float, float]
    obstacles: Places

    def answer(self, grids: Grids) -> tuple[Offer, ...]:
        grid = grids.of(self.revision)
        here = grid.cell(self.pose.x_m, self.pose.y_m)
        if not grid.contains(here) or not self.entries:
            return ()
        prices = cell_prices(grid, here, blocked_cells(grid, self.obstacles))
        walking = WalkingDistances(prices, grid.cell_m)
        from_here = walking.of(here, self.entries)
        nearest = [int(i) for i in np.argsort(from_here, kind="stable") if np.isfinite(from_here[i])][:PLACES_MAX]
        stops = [here, *(self.entries[i] for i in nearest), grid.cell(*self.home)]
        between = np.array([walking.of(stop, stops) for stop in stops])
        between = np.minimum(between, FAR_M)
        detours_m = (between[0, 1:-1] + between[1:-1, -1] - between[0, -1]).tolist()
        costs = zip(nearest, between[0, 1:-1].tolist(), detours_m, tours_m(between), strict=True)
        return tuple(Offer(*cost) for cost in costs)


@dataclass(frozen=True, slots=True)
class FindSpots:
    """Where can walls be seen that were not yet? `imaged`: what was. The answer as of `spots`."""

    revision: int
    pose: Pose2
    imaged: Imaged

    def answer(self, grids: Grids) -> dict[Cell, float]:
        return spots(grids.of(self.revision), self.imaged, self.pose)
