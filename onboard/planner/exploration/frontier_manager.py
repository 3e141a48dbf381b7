"""What the newest grid offers, with all obstacles that were met left out: the list of side halls, and the paths there.

View in; frontier, list, straight paths and routes out. What was visited, put off or met is remembered here.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from common.geometry import Pose2
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontiers import Frontier, FrontierGroup, FrontierMemory
from onboard.planner.exploration.recovery_memory import Obstacles
from onboard.planner.grid.grid_map import Cell, Mask
from onboard.planner.grid.sliced_work import Work
from onboard.planner.grid.view import View
from onboard.planner.routing.path_following import Path
from onboard.planner.routing.route_planning import cheapest_path

LIST_PATIENCE = 3  # grids without any reachable frontier before the floor counts as done
STILL_WANTED_M = 0.5  # between the end of a path and the frontier it was planned for


class FrontierManager:
    """`take_in` comes first in every tick; `frontier` and `groups`, the list, are as of then."""

    def __init__(self) -> None:
        self.frontier: Frontier = frontiers.NOWHERE
        self.groups: list[FrontierGroup] = []
        self._blocked: Mask = np.zeros((0, 0), dtype=bool)
        self._grid_seen = -1
        self._memory = FrontierMemory()
        self._obstacles = Obstacles()
        self._empty_lists = 0

    def take_in(self, view: View) -> None:
        """Judge the grid where it is new."""
        self._obstacles.forget(view.now_s)
        if view.grid_revision != self._grid_seen:
            self._grid_seen = view.grid_revision
            self._blocked = self._obstacles.mask(view.grid)
            self.frontier = self._memory.frontier(view.grid, self._blocked, view.pose)
            self.groups = frontiers.groups(view.grid, self.frontier)

    def judge_anew(self) -> None:
        """The next tick reads its grid anew, even if it is the same."""
        self._grid_seen = -1

    def meet(self, x_m: float, y_m: float, now_s: float) -> None:
        """Something stands here that the map does not know: plan around it for a while."""
        self._obstacles.add(x_m, y_m, now_s)
        # Most often this is a wall that was approached obliquely and is not on the map yet: no frontier lies behind it
        self._memory.defer(x_m, y_m)
        self.judge_anew()

    def defer(self, x_m: float, y_m: float) -> None:
        """Something kept the robot from this position."""
        self._memory.defer(x_m, y_m)

    def mark_visited(self, x_m: float, y_m: float) -> None:
        """This position was visited."""
        self._memory.mark_visited(x_m, y_m)

    def exhausted(self, now_s: float) -> bool:
        """Called when no path leads to the list: is it empty for good? If that is uncertain, the grid is read anew."""
        # An obstacle may hide a path: it must be forgotten first
        self._empty_lists += 0 if self._obstacles.may_hide_a_path(now_s) else 1
        if self._empty_lists < LIST_PATIENCE or self._memory.try_again():
            self.judge_anew()
            return False
        return True

    @property
    def second_try(self) -> bool:
        """Are the frontiers that were deferred on the list again?"""
        return self._memory.second_try

    def renew_patience(self) -> None:
        """Called when there was something to drive to: the count of empty lists begins again."""
        self._empty_lists = 0

    def straight_reach_m(self, view: View, pose: Pose2) -> float:
        """How far the footprint can go straight on from a pose."""
        return frontiers.straight_reach_m(view.grid, pose, pose.heading_rad, self._blocked)

    def something_ahead(self, view: View, pose: Pose2, side_m: float = frontiers.STRAIGHT_SIDE_M) -> bool:
        """Would driving straight on from a pose show new floor, up to `side_m` aside?"""
        reach_m = self.straight_reach_m(view, pose)
        return frontiers.something_ahead(view.grid, self.frontier, pose, pose.heading_rad, reach_m, side_m)

    def something_near(self, x_m: float, y_m: float) -> bool:
        """Is there still frontier near this position?"""
        gap = self.frontier.points - np.array([x_m, y_m])
        return bool((np.hypot(gap[:, 0], gap[:, 1]) < STILL_WANTED_M).any())

    def route(self, view: View, wanted: Collection[Cell]) -> Work[Path | None]:
        """Waypoints to the cheapest of the wanted cells; None where no path leads there."""
        return cheapest_path(view.grid, view.pose, wanted, self._obstacles.mask(view.grid))

    def is_clear(self, view: View, path: Path) -> bool:
        """Nothing that was met stands on the next two legs, and no wall was seen on the next."""
        here = (view.pose.x_m, view.pose.y_m)
        on_legs = any(self._obstacles.on_leg(a, b) for a, b in pairwise([here, *path[:2]]))
        return not on_legs and view.grid.sees(here, path[0])
