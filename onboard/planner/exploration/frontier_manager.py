"""What the newest grid offers, with all obstacles that were met left out: the list of side halls, and the paths there.

A judged grid in; frontier, list, straight paths and the queries for more out. What was visited, put off or met is
remembered here.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise
from math import inf

import numpy as np

from common.geometry import Pose2
from common.messages.mapping import GridUpdate
from common.zones import Zone
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontiers import Frontier, FrontierGroup, FrontierMemory
from onboard.planner.exploration.queries import (
    FindPath,
    FindPathBefore,
    IsKeptOut,
    JudgedGrid,
    JudgeGrid,
    JudgeLeftOut,
    Offer,
    PlanTours,
)
from onboard.planner.exploration.recovery_memory import Obstacles
from onboard.planner.exploration.trail import Trail
from onboard.planner.grid.deliberation import Deliberation
from onboard.planner.grid.grid_map import Cell
from onboard.planner.grid.view import View
from onboard.planner.routing.path_following import Path

FORGOTTEN_MAX = 5  # then an obstacle that leaves no path is one that stays
LIST_PATIENCE = 3  # grids without any reachable frontier before the floor counts as done
BLACKLISTED_MAX = 50  # are listed
KEPT_OUT = "a no-go line or area keeps the robot from it"
STILL_WANTED_M = 0.5  # between the end of a path and the frontier it was planned for


class FrontierManager:
    """`frontier` and `groups`, the list, are those of the judged grid that was taken in last."""

    def __init__(self) -> None:
        self.frontier: Frontier = frontiers.NOWHERE
        self.groups: list[FrontierGroup] = []
        self.trail = Trail()
        self._memory = FrontierMemory()
        self._obstacles = Obstacles()
        self._changes = self._judged_changes = 0  # of what is left out: all, and those that the list has
        self._empty_lists = 0
        self._forgotten = 0  # how often all obstacles were, for an empty list

    def query(
        self, revision: int, pose: Pose2, update: GridUpdate | None = None, zones: tuple[Zone, ...] = ()
    ) -> JudgeGrid:
        """About a grid, with all that is to be left out now; `zones` belong to an `update`."""
        left_out, obstacles = self._memory.left_out, self._obstacles.places
        return JudgeGrid(revision, pose, left_out, obstacles, self.trail.points, self._changes, update, zones)

    def take_in(self, judged: JudgedGrid) -> None:
        """The answer."""
        self.frontier, self.groups, self._judged_changes = judged.frontier, judged.groups, judged.changes

    def judged(self, view: View) -> Deliberation[None]:
        """Has the grid judged once more where something is to be left out since."""
        if self._judged_changes != self._changes:
            self.take_in((yield self.query(view.grid_revision, view.pose)))

    def forget(self, now_s: float) -> None:
        """Obstacles whose time is over."""
        self._obstacles.forget(now_s)

    def forget_obstacles(self) -> bool:
        """All of them, whatever their time; False where none was left."""
        forgotten = self._obstacles.forget(inf)
        self.judge_anew()
        return forgotten

    def judge_anew(self) -> None:
        """What is chosen next is chosen of a list that was made after this."""
        self._changes += 1

    def meet(self, x_m: float, y_m: float, now_s: float) -> None:
        """Something stands here that the map does not know: plan around it for a while."""
        self._obstacles.add(x_m, y_m, now_s)
        # Most often this is a wall that was approached obliquely and is not on the map yet: no frontier lies behind it
        self.defer(x_m, y_m, "something stands in the way")

    def defer(self, x_m: float, y_m: float, why: str) -> None:
        """Something kept the robot from this position."""
        self._memory.defer(x_m, y_m, why)
        self.judge_anew()

    def mark_visited(self, x_m: float, y_m: float) -> None:
        """This position was visited."""
        self._memory.mark_visited(x_m, y_m)
        self.judge_anew()

    def exhausted(self, now_s: float) -> bool:
        """Called when no path leads to the list: is it empty for good? If that is uncertain, it is made anew."""
        # An obstacle may hide a path: it must be forgotten first
        self._empty_lists += 0 if self._obstacles.may_hide_a_path(now_s) else 1
        if self._empty_lists < LIST_PATIENCE:
            self.judge_anew()
            return False
        if self._forgotten < FORGOTTEN_MAX and self.forget_obstacles():
            self._forgotten += 1
            return False
        if self._memory.try_again():
            self.judge_anew()
            return False
        return True

    def blacklisted(self, view: View) -> Deliberation[tuple[str, ...]]:
        """What is left unseen when exploration ends: places with the reason for each."""
        listed: list[tuple[FrontierGroup, bool]] = yield JudgeLeftOut(view.grid_revision, view.pose, self.trail.points)
        return tuple(
            f"{group.x_m:.1f},{group.y_m:.1f}: {KEPT_OUT if kept_out else self._memory.reason(group.points)}"
            for group, kept_out in listed[:BLACKLISTED_MAX]
        )

    @property
    def second_try(self) -> bool:
        """Are the frontiers that were deferred on the list again?"""
        return self._memory.second_try

    def renew_patience(self) -> None:
        """Called when there was something to drive to: the count of empty lists begins again."""
        self._empty_lists = 0

    def straight_reach_m(self, view: View, pose: Pose2) -> float:
        """How far the footprint can go straight on from a pose."""
        return frontiers.straight_reach_m(view.grid, pose, pose.heading_rad, self._obstacles.places)

    def something_ahead(
        self, view: View, pose: Pose2, side_m: float = frontiers.STRAIGHT_SIDE_M, of: Frontier | None = None
    ) -> bool:
        """Would driving straight on from a pose show new floor, up to `side_m` aside? `of`: some of it only."""
        reach_m = self.straight_reach_m(view, pose)
        frontier = self.frontier if of is None else of
        return frontiers.something_ahead(view.grid, frontier, pose, pose.heading_rad, reach_m, side_m)

    def something_near(self, x_m: float, y_m: float) -> bool:
        """Is there still frontier near this position?"""
        gap = self.frontier.points - np.array([x_m, y_m])
        return bool((np.hypot(gap[:, 0], gap[:, 1]) < STILL_WANTED_M).any())

    def offers(self, view: View, home: tuple[float, float]) -> Deliberation[list[tuple[FrontierGroup, Offer]]]:
        """What it costs to begin with each entry of the list that can be reached; the nearest first."""
        listed = self.groups
        entrances = tuple(frontiers.entrance(view.grid, group) for group in listed)
        found: tuple[Offer, ...] = yield PlanTours(
            view.grid_revision, view.pose, entrances, home, self._obstacles.places
        )
        return [(listed[offer.entry], offer) for offer in found]

    def route(self, view: View, wanted: Collection[Cell]) -> Deliberation[Path | None]:
        """Waypoints to the cheapest of the wanted cells; None where no path leads there."""
        path: Path | None = yield FindPath(view.grid_revision, view.pose, wanted, self._obstacles.places)
        return path

    def route_before(self, view: View, place_m: tuple[float, float]) -> Deliberation[Path | None]:
        """Waypoints to where it can stand nearest to a place at which it cannot; None where that is far from it."""
        path: Path | None = yield FindPathBefore(view.grid_revision, view.pose, place_m, self._obstacles.places)
        return path

    def kept_out(self, view: View, wanted: Collection[Cell]) -> Deliberation[bool]:
        """Do zones alone keep the robot from all of the wanted cells, as long as they stand?"""
        answer: bool = yield IsKeptOut(view.grid_revision, view.pose, wanted)
        return answer

    def is_clear(self, view: View, path: Path) -> bool:
        """Nothing that was met stands on the next two legs, and no wall was seen on the next."""
        here = (view.pose.x_m, view.pose.y_m)
        on_legs = any(self._obstacles.on_leg(a, b) for a, b in pairwise([here, *path[:2]]))
        return not on_legs and view.grid.sees(here, path[0])
