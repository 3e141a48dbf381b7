"""What the newest grid offers, with all that was met in the way left out: the list of side halls, and the ways there.

View in; frontier, list, straight ways and routes out. What was looked into, put off or met is remembered here.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from common.geometry import Pose2
from onboard.planner import exploration
from onboard.planner.exploration import Exploration, Frontier, FrontierGroup
from onboard.planner.grid_map import Cell, Mask
from onboard.planner.route_planning import cheapest_way
from onboard.planner.setbacks import Obstacles
from onboard.planner.view import View
from onboard.planner.way_following import Way
from onboard.planner.work import Work

LIST_PATIENCE = 3  # grids without any reachable frontier before the floor counts as done
STILL_WANTED_M = 0.5  # between the end of a way and the frontier it was planned for


class Prospects:
    """`take_in` comes first in every tick; `frontier` and `groups`, the list, are as of then."""

    def __init__(self) -> None:
        self.frontier: Frontier = exploration.NOWHERE
        self.groups: list[FrontierGroup] = []
        self._blocked: Mask = np.zeros((0, 0), dtype=bool)
        self._grid_seen = -1
        self._exploration = Exploration()
        self._obstacles = Obstacles()
        self._empty_lists = 0

    def take_in(self, view: View) -> None:
        """Judge the grid where it is new."""
        self._obstacles.forget(view.now_s)
        if view.grid_revision != self._grid_seen:
            self._grid_seen = view.grid_revision
            self._blocked = self._obstacles.mask(view.grid)
            self.frontier = self._exploration.frontier(view.grid, self._blocked, view.pose)
            self.groups = exploration.groups(view.grid, self.frontier)

    def judge_anew(self) -> None:
        """With the next tick, whether its grid is new or not."""
        self._grid_seen = -1

    def meet(self, x_m: float, y_m: float, now_s: float) -> None:
        """Something stands here that the map does not know: plan around it for a while."""
        self._obstacles.add(x_m, y_m, now_s)
        # Most often this is a wall that was met at a slant and not yet placed: nothing is to be found behind it
        self._exploration.put_off(x_m, y_m)
        self.judge_anew()

    def put_off(self, x_m: float, y_m: float) -> None:
        """Something kept the robot from this position."""
        self._exploration.put_off(x_m, y_m)

    def give_up(self, x_m: float, y_m: float) -> None:
        """This position was looked into."""
        self._exploration.give_up(x_m, y_m)

    def exhausted(self, now_s: float) -> bool:
        """Nothing of the list could be driven to: is that so for good? Where it may not be, all is judged anew."""
        # What stands in the way may hide a way: nothing is concluded before it is forgotten
        self._empty_lists += 0 if self._obstacles.may_hide_a_way(now_s) else 1
        if self._empty_lists < LIST_PATIENCE or self._exploration.try_again():
            self.judge_anew()
            return False
        return True

    def renew_patience(self) -> None:
        """There was something to drive to."""
        self._empty_lists = 0

    def straight_reach_m(self, view: View, pose: Pose2) -> float:
        """How far the hull can go straight on from a pose."""
        return exploration.straight_reach_m(view.grid, pose, pose.heading_rad, self._blocked)

    def something_ahead(self, view: View, pose: Pose2, side_m: float = exploration.STRAIGHT_SIDE_M) -> bool:
        """Would driving straight on from a pose show new floor, up to `side_m` aside?"""
        reach_m = self.straight_reach_m(view, pose)
        return exploration.something_ahead(view.grid, self.frontier, pose, pose.heading_rad, reach_m, side_m)

    def something_near(self, x_m: float, y_m: float) -> bool:
        """Is there still frontier near this position?"""
        gap = self.frontier.points - np.array([x_m, y_m])
        return bool((np.hypot(gap[:, 0], gap[:, 1]) < STILL_WANTED_M).any())

    def route(self, view: View, wanted: Collection[Cell]) -> Work[Way | None]:
        """Way points to the cheapest of the wanted cells; None where no way leads there."""
        return cheapest_way(view.grid, view.pose, wanted, self._obstacles.mask(view.grid))

    def is_clear(self, view: View, way: Way) -> bool:
        """Nothing that was met stands on the next two legs, and no wall was seen on the next."""
        here = (view.pose.x_m, view.pose.y_m)
        on_legs = any(self._obstacles.on_leg(a, b) for a, b in pairwise([here, *way[:2]]))
        return not on_legs and view.grid.sees(here, way[0])
