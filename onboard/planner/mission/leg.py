"""Straight driving along a hall, or a wall that the camera has not seen: when it is judged, and whether it goes on."""

from __future__ import annotations

from dataclasses import replace

from common.geometry import Pose2
from onboard.planner.driving.hall_following import HallFollowing
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontier_manager import FrontierManager
from onboard.planner.exploration.frontiers import as_set
from onboard.planner.exploration.wall_imaging import WallImaging
from onboard.planner.grid.grid_map import Cell
from onboard.planner.grid.view import View

REVIEW_M = 1.5  # of a leg, between two looks at the list


class Leg:
    """From `begin` to where it ends; the hall that it follows is `HallFollowing`'s."""

    def __init__(self, frontier_manager: FrontierManager, hall: HallFollowing, imaging: WallImaging | None) -> None:
        self._frontiers = frontier_manager
        self._hall = hall
        self._imaging = imaging
        self._reviewed = Pose2(0.0, 0.0, 0.0)  # where it was asked last whether another entry should come first
        self._judged: tuple[int, Pose2] | None = None  # grid and place where the leg was found worth going on

    def begin(self, pose: Pose2, heading_rad: float) -> None:
        """A new leg from here."""
        self._hall.begin(pose, heading_rad)
        self._reviewed, self._judged = pose, None

    def due(self, view: View) -> bool:
        """Is it to be judged now? Once on every grid and every half cell."""
        if self._judged is not None:
            revision, pose = self._judged
            if revision == view.grid_revision and pose.distance_m(view.pose) < view.grid.cell_m / 2:
                return False
        self._judged = (view.grid_revision, view.pose)
        return True

    def to_review(self, view: View) -> set[Cell] | None:
        """Of a hall: an opening on the right that was just passed, none after a while; None where neither is so."""
        opening = self._hall.opening_passed(view.grid, self._frontiers.frontier, view.pose)
        if opening is None and self._reviewed.distance_m(view.pose) <= REVIEW_M:
            return None
        return as_set(opening) if opening is not None else set()

    def reviewed(self, pose: Pose2) -> None:
        """The list is looked at from here."""
        self._reviewed = pose

    def shows_new_floor(self, view: View) -> bool:
        """Of a hall: is it worth going on?"""
        return self._frontiers.something_ahead(view, self._pose(view))

    def shows_new_wall(self, view: View) -> bool:
        """Of a wall: is it worth going on? What the camera sees from here counts as seen."""
        assert self._imaging is not None
        self._imaging.settle(view.grid, view.pose)
        leg = self._pose(view)
        open_ahead = self._frontiers.straight_reach_m(view, leg) >= frontiers.STRAIGHT_MIN_M
        return open_ahead and self._imaging.worth_going_on(view.grid, view.pose, leg.heading_rad)

    def _pose(self, view: View) -> Pose2:
        return replace(view.pose, heading_rad=self._hall.heading_rad)
