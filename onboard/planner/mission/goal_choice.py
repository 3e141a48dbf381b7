"""Where to go next: grid, frontiers and walls that the camera has not seen in; the event that follows and its path out.

First what the right-hand rule takes, then the nearest of the list, then a wall, then home.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import hypot, pi

from common.geometry import Pose2, wrap_angle
from onboard.planner.driving.hall_following import STEER_MAX_RAD, HallFollowing
from onboard.planner.driving.looking import HEADING_REACHED_RAD
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontier_manager import FrontierManager
from onboard.planner.exploration.frontiers import FrontierGroup
from onboard.planner.exploration.junction import Junction
from onboard.planner.exploration.order import too_far, worthwhile
from onboard.planner.exploration.queries import FindSpots
from onboard.planner.exploration.right_hand_rule import Turn
from onboard.planner.exploration.wall_imaging import WallImaging, beginning
from onboard.planner.grid.deliberation import Deliberation
from onboard.planner.grid.grid_map import Cell
from onboard.planner.grid.view import View
from onboard.planner.mission.table import Event
from onboard.planner.routing.path_following import Path

GROUPS_NOTED = 8  # of the list
HOME_M = (0.0, 0.0)  # in the map, where the robot started


@dataclass(frozen=True, slots=True)
class Goal:
    """What follows: the event, the heading to look or drive along, or the path and the heading at its end."""

    event: Event
    heading_rad: float
    why: str = ""  # its figures, for the log
    path: Path = field(default_factory=list)
    blacklisted: tuple[str, ...] = ()  # where exploration ends: what it leaves out, and why


class GoalChoice:
    """Chooses the next goal. What that needs of a floor of any size it asks for: a choice takes some steps.

    Decides when exploration is complete: `_of_list` returns `Event.EXPLORED` where no side hall and no wall is left.
    """

    def __init__(self, frontier_manager: FrontierManager, hall: HallFollowing, imaging: WallImaging | None) -> None:
        self.junction = Junction()
        self._frontiers = frontier_manager
        self._hall = hall
        self._imaging = imaging

    def next(self, view: View, looked_rad: float | None) -> Deliberation[Goal]:
        """After a leg, a look, or where a path is lost; `looked_rad`: the robot has just looked there."""
        heading_rad = self._hall.along(view.pose.heading_rad)
        if _stands_askew(view.pose, heading_rad, looked_rad):
            return Goal(Event.TURN, heading_rad, "stands askew")
        yield from self._frontiers.judged(view)
        offers = yield from self._frontiers.offers(view, HOME_M)
        next_ones = worthwhile(offers)
        headings_rad = {turn: self._hall.along(wrap_angle(heading_rad + turn.value)) for turn in Turn}
        choice = self.junction.choose(view, self._frontiers, headings_rad, frontiers.together(next_ones))
        if choice.turn is Turn.FORWARD:
            self._frontiers.renew_patience()
            return Goal(Event.AHEAD, heading_rad, str(choice))
        if choice.turn is not None:
            return Goal(Event.TURN, headings_rad[choice.turn], str(choice))
        far = [group for group, offer in offers if too_far(group, offer)]
        listed = [group for group in self._frontiers.groups if group not in far]
        goal = yield from self._of_list(view, next_ones, listed)
        return replace(goal, why=f"{choice} {goal.why}")

    def on_leg(self, view: View, opening: set[Cell]) -> Deliberation[Goal | None]:
        """While it follows a hall: an opening on the right that was just passed, or what costs less than going on
        here; None where the leg goes on."""
        if opening:
            return (yield from self.side_hall(view, opening))
        next_ones = worthwhile((yield from self._frontiers.offers(view, HOME_M)))
        leg = replace(view.pose, heading_rad=self._hall.heading_rad)
        if not next_ones or self._frontiers.something_ahead(view, leg, of=frontiers.together(next_ones)):
            return None
        return (yield from self.side_hall(view, frontiers.roomy_cells(view.grid, next_ones)))

    def side_hall(self, view: View, frontier: set[Cell]) -> Deliberation[Goal | None]:
        """The nearest of these cells; None where no path leads there."""
        path = (yield from self._frontiers.route(view, frontier)) if frontier else None
        if path is None:
            return None
        self._frontiers.renew_patience()
        return Goal(Event.SIDE_HALL, view.pose.heading_rad, _figures(path, self._frontiers.groups), path)

    def _of_list(self, view: View, next_ones: list[FrontierGroup], listed: list[FrontierGroup]) -> Deliberation[Goal]:
        """The nearest of the entries that may come next, else of all listed ones, else a wall, else home."""
        for groups in (next_ones, listed):
            goal = yield from self.side_hall(view, frontiers.roomy_cells(view.grid, groups))
            if goal is not None:
                return goal
        second_try = self._frontiers.second_try
        if not self._frontiers.exhausted(view.now_s):
            again = self._frontiers.second_try is not second_try
            why = "list empty: what was deferred is tried once more" if again else ""
            aside_rad = self._hall.along(
                wrap_angle(view.pose.heading_rad + pi / 2)
            )  # what it sees there may open a path
            return Goal(Event.LIST_UNSURE, aside_rad, why)
        goal = yield from self._wall(view)
        if goal is not None:
            return goal
        blacklisted = yield from self._frontiers.blacklisted(view)
        return Goal(Event.EXPLORED, view.pose.heading_rad, f"blacklisted={len(blacklisted)}", blacklisted=blacklisted)

    def _wall(self, view: View) -> Deliberation[Goal | None]:
        """The nearest stretch of wall that the camera has not seen, from its beginning; None where there is none."""
        if self._imaging is None:
            return None
        spots: dict[Cell, float] = yield FindSpots(view.grid_revision, view.pose, self._imaging.imaged)
        path = (yield from self._frontiers.route(view, tuple(spots))) if spots else None
        if path is None:
            return None
        first = beginning(spots, view.grid, view.grid.cell(*path[-1]))
        path = (yield from self._frontiers.route(view, {first})) or path
        heading_rad = self._hall.along(spots[view.grid.cell(*path[-1])])
        return Goal(Event.WALL, heading_rad, f"{_figures(path, [])} spots={len(spots)}", path)


def _stands_askew(pose: Pose2, heading_rad: float, looked_rad: float | None) -> bool:
    """Does it have to turn to the hall's direction before it can judge the branches, and has not tried to yet?"""
    tried = looked_rad is not None and abs(wrap_angle(heading_rad - looked_rad)) < HEADING_REACHED_RAD
    return abs(wrap_angle(heading_rad - pose.heading_rad)) > STEER_MAX_RAD and not tried


def _figures(path: Path, groups: list[FrontierGroup]) -> str:
    """Where it leads, how far, and what else was on the list."""
    length_m = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(path))
    others = ";".join(f"{group.x_m:.1f},{group.y_m:.1f}" for group in groups[:GROUPS_NOTED])
    return f"place={path[-1][0]:.2f},{path[-1][1]:.2f} path_m={length_m:.1f} list={len(groups)}:{others}"
