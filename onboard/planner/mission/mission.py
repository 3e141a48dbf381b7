"""The mission: explore by the right-hand rule and the list of side halls, come home, stop.

A state machine that is asked ten times a second for the motion it wants, given pose, grid, wall points and distances.
It knows no messages and no clock of its own.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from math import atan2, cos, hypot, pi, sin
from typing import Any

from common.geometry import Pose2, wrap_angle
from common.messages import Speed
from onboard.planner.driving.hall_following import STEER_MAX_RAD, HallFollowing
from onboard.planner.driving.looking import HEADING_REACHED_RAD, TURN_TIMEOUT_S, Looking
from onboard.planner.exploration import frontiers
from onboard.planner.exploration.frontier_manager import FrontierManager
from onboard.planner.exploration.frontiers import FrontierGroup, as_set
from onboard.planner.exploration.junction import Junction
from onboard.planner.exploration.recovery_memory import Stillness
from onboard.planner.exploration.right_hand_rule import Turn
from onboard.planner.exploration.wall_imaging import WallImaging, beginning
from onboard.planner.grid.grid_map import Cell
from onboard.planner.grid.sliced_work import Sliced, Work
from onboard.planner.grid.view import Motion, View
from onboard.planner.routing.path_following import Path, arrived, rest_of, speed_along

BLOCK_AHEAD_M = 0.45
RETRY_S = 3.0
GOAL_NEAR_CELLS = 1  # of the grid, around a place to drive to
GOAL_FAR_CELLS = 4  # where the footprint cannot stand at the place itself
OBSTRUCTIONS_MAX = 2  # next to where it wants to get, then that is given up
OBSTRUCTION_NEAR_M = 1.5


class Mode(Enum):
    """What the mission is about; the value is what people read."""

    WAITING = "waiting for start"
    STRAIGHT = "following the hall"
    ROUTE = "driving to a side hall"
    LOOK = "looking"
    IMAGE = "driving to a wall that the camera has not seen"
    ALONG_WALL = "following a wall that the camera has not seen"
    HOME = "driving home"
    ALIGN = "home, turning to the first heading"
    GOTO = "driving to a place"
    RETAKE = "driving to where a photo is wanted"
    DONE = "done"
    STUCK = "no path; waiting"


class Mission:
    """`step` returns the wanted motion; `mode`, `groups` and `path` show people what it is about."""

    def __init__(self, images_walls: bool = False) -> None:
        """`images_walls`: there is a camera, and every wall shall have been on its right."""
        self.mode = Mode.WAITING
        self.path: Path = []
        self._frontiers = FrontierManager()
        self._junction = Junction()
        self._hall = HallFollowing()
        self._looking = Looking()
        self._target: tuple[float, float] = (0.0, 0.0)
        self._last_s: float | None = None
        self._stillness = Stillness()
        self._imaging = WallImaging() if images_walls else None
        self._wall_rad = 0.0  # heading for the next leg along a wall
        self._wall_due = False  # that leg comes next
        self._obstructions = 0  # since the last arrival
        self._retake_rad = 0.0
        self._retry_s = 0.0
        self._retry_mode = Mode.HOME
        self._align_until_s = 0.0
        self._deliberation: Sliced[Any] | None = None  # a choice or a path that took more than one step so far

    @property
    def groups(self) -> list[FrontierGroup]:
        """The list of side halls."""
        return self._frontiers.groups

    @property
    def finished(self) -> bool:
        return self.mode is Mode.DONE

    @property
    def deliberates(self) -> bool:
        """It has not yet found out where to go next: the sooner its next step the better, on the same grid."""
        return self._deliberation is not None

    def start(self, pose: Pose2, now_s: float) -> None:
        """Begin to explore; once more from the beginning of the list after a finished mission."""
        if self.mode in (Mode.WAITING, Mode.DONE):
            self._frontiers.renew_patience()
            self._look(pose.heading_rad, now_s)

    def go_home(self) -> None:
        """Give up what is left of the list."""
        self.mode, self.path, self._deliberation = Mode.HOME, [], None

    def go_to(self, x_m: float, y_m: float) -> None:
        """Drive to a place on the map, and stay there."""
        self.mode, self.path, self._target = Mode.GOTO, [], (x_m, y_m)
        self._deliberation = None

    def detour(self, pose: Pose2) -> None:
        """Stand at a pose for another photo, then go on exploring."""
        if self.mode in (Mode.STRAIGHT, Mode.ROUTE, Mode.LOOK, Mode.IMAGE, Mode.ALONG_WALL):
            self.mode, self.path, self._target = Mode.RETAKE, [], (pose.x_m, pose.y_m)
            self._deliberation = None
            self._retake_rad = pose.heading_rad

    def end_detour(self, heading_rad: float, now_s: float) -> None:
        """Nobody wants that photo any more."""
        if self.mode is Mode.RETAKE:
            self._look(heading_rad, now_s)

    def blocked(self, view: View, bearing_rad: float) -> None:
        """An obstacle stands there that the map does not know: plan around it for a while."""
        angle = view.pose.heading_rad + bearing_rad
        x_m, y_m = view.pose.x_m + BLOCK_AHEAD_M * cos(angle), view.pose.y_m + BLOCK_AHEAD_M * sin(angle)
        self._frontiers.meet(x_m, y_m, view.now_s)
        if self.mode in (Mode.STRAIGHT, Mode.ALONG_WALL):
            self._end_leg(view)
        elif self._visiting and hypot(self._target[0] - x_m, self._target[1] - y_m) < OBSTRUCTION_NEAR_M:
            self._obstructions += 1
            if self._obstructions >= OBSTRUCTIONS_MAX:
                self._obstructions = 0
                self._give_path_up(view)
                self._look(view.pose.heading_rad, view.now_s)
        self.path, self._deliberation = [], None

    def step(self, view: View) -> Motion:
        """The motion that is wanted now."""
        dt_s = view.now_s - self._last_s if self._last_s is not None else 0.0
        self._last_s = view.now_s
        if not self.deliberates:
            self._frontiers.take_in(view)
        if self._imaging is not None:
            self._imaging.look(view.grid, view.pose)
        return self._act(view, dt_s)

    def _act(self, view: View, dt_s: float) -> Motion:
        stand = Motion(Speed.STOP, view.pose.heading_rad)
        if self._stillness.stagnates(view.pose, dt_s, under_way=self._visiting):
            self._give_path_up(view)
            self._frontiers.judge_anew()
            self._look(view.pose.heading_rad, view.now_s)
            return stand
        if self.deliberates:
            self._carry_on()
            return stand
        if self.mode in (Mode.WAITING, Mode.DONE):
            return stand
        if self.mode is Mode.LOOK:
            return self._stand_and_look(view)
        if self.mode in (Mode.STRAIGHT, Mode.ALONG_WALL):
            return self._drive_leg(view)
        if self.mode is Mode.ALIGN:
            if abs(wrap_angle(view.pose.heading_rad)) < HEADING_REACHED_RAD or view.now_s > self._align_until_s:
                self.mode = Mode.DONE
            return Motion(Speed.STOP, 0.0)
        if self.mode is Mode.STUCK:
            if view.now_s >= self._retry_s:
                self.mode = self._retry_mode
            return stand
        return self._follow_path(view)

    @property
    def _visiting(self) -> bool:
        """On its way to a place of its own choice, which it may defer."""
        return self.mode in (Mode.ROUTE, Mode.IMAGE)

    def _give_path_up(self, view: View) -> None:
        if self.mode is Mode.IMAGE and self._imaging is not None:
            self._imaging.settle(view.grid, Pose2(*self._target, self._wall_rad))
        else:
            self._frontiers.defer(*self._target)

    def _look(self, heading_rad: float, now_s: float, then_rad: float | None = None) -> None:
        self.mode, self.path, self._wall_due, self._deliberation = Mode.LOOK, [], False, None
        self._looking.begin(heading_rad, now_s, then_rad)

    def _stand_and_look(self, view: View) -> Motion:
        if self._looking.over(view.pose, view.now_s):
            self._deliberate(self._choose(view))
        return Motion(Speed.STOP, self._looking.heading_rad)

    def _deliberate(self, work: Work[Any]) -> None:
        self._deliberation = Sliced(work)
        self._carry_on()

    def _carry_on(self) -> None:
        if self._deliberation is not None and self._deliberation.advance():
            self._deliberation = None

    def _choose(self, view: View) -> Work[None]:
        """The wall that was driven to, else what the right-hand rule takes, else the next of the list."""
        if self._wall_due:
            self.mode, self._wall_due = Mode.ALONG_WALL, False
            self._hall.begin(view.pose, self._wall_rad)
            return
        heading_rad = self._hall.along(view.pose.heading_rad)
        if self._stands_askew(view.pose, heading_rad):
            self._look(heading_rad, view.now_s)
            return
        headings_rad = {turn: self._hall.along(wrap_angle(heading_rad + turn.value)) for turn in Turn}
        turn = self._junction.choose(view, self._frontiers, headings_rad)
        if turn is None:
            yield from self._take_from_list(view)
        elif turn is Turn.FORWARD:
            self.mode = Mode.STRAIGHT
            self._frontiers.renew_patience()
            self._hall.begin(view.pose, heading_rad)
        else:
            self._look(headings_rad[turn], view.now_s)

    def _stands_askew(self, pose: Pose2, heading_rad: float) -> bool:
        """Does it have to turn to the hall's direction before it can judge the branches, and has not tried to yet?"""
        gap_rad = abs(wrap_angle(heading_rad - self._looking.heading_rad))
        tried = self.mode is Mode.LOOK and gap_rad < HEADING_REACHED_RAD
        return abs(wrap_angle(heading_rad - pose.heading_rad)) > STEER_MAX_RAD and not tried

    def _take_from_list(self, view: View) -> Work[None]:
        """Set out for the nearest of the list, else for a wall, else home."""
        if (yield from self._set_out(view, frontiers.roomy_cells(view.grid, self.groups))):
            return
        if not self._frontiers.exhausted(view.now_s):
            self._look(view.pose.heading_rad, view.now_s)
        elif not (yield from self._set_out_to_a_wall(view)):
            self.go_home()

    def _set_out(self, view: View, frontier: set[Cell]) -> Work[bool]:
        """For the nearest of these cells; False where no path leads there."""
        route = (yield from self._frontiers.route(view, frontier)) if frontier else None
        if route is None:
            return False
        self._frontiers.renew_patience()
        self.mode, self.path, self._target = Mode.ROUTE, route, route[-1]
        return True

    def _set_out_to_a_wall(self, view: View) -> Work[bool]:
        """The nearest stretch of wall that the camera has not seen, from its beginning; False where there is none."""
        spots = (yield from self._imaging.spots(view.grid, view.pose)) if self._imaging is not None else {}
        route = (yield from self._frontiers.route(view, spots)) if spots else None
        if route is None:
            return False
        first = beginning(spots, view.grid, view.grid.cell(*route[-1]))
        route = (yield from self._frontiers.route(view, {first})) or route
        self.mode, self.path, self._target = Mode.IMAGE, route, route[-1]
        self._wall_rad = self._hall.along(spots[view.grid.cell(*route[-1])])
        return True

    def _drive_leg(self, view: View) -> Motion:
        """Straight on along a hall or a wall, as long as that shows something new."""
        pose = view.pose
        self._hall.see(view.points, pose)
        if self.mode is Mode.STRAIGHT:
            opening = self._hall.opening_passed(view.grid, self._frontiers.frontier, pose)
            if opening is not None:
                self._deliberate(self._set_out(view, as_set(opening)))
                if self.mode is not Mode.STRAIGHT or self.deliberates:
                    return Motion(Speed.STOP, pose.heading_rad)
        elif self._imaging is not None:
            self._imaging.settle(view.grid, pose)
        if view.front_is_near or not self._leg_shows_new(view):
            self._end_leg(view)
            return Motion(Speed.STOP, pose.heading_rad)
        return Motion(Speed.MEDIUM, self._hall.steered_rad(pose, view.left_m, view.right_m))

    def _leg_shows_new(self, view: View) -> bool:
        leg = replace(view.pose, heading_rad=self._hall.heading_rad)
        if self.mode is Mode.STRAIGHT:
            return self._frontiers.something_ahead(view, leg)
        assert self._imaging is not None
        open_ahead = self._frontiers.straight_reach_m(view, leg) >= frontiers.STRAIGHT_MIN_M
        return open_ahead and self._imaging.worth_going_on(view.grid, view.pose, leg.heading_rad)

    def _end_leg(self, view: View) -> None:
        self._junction.end_leg(self._hall.start, view.pose)
        heading_rad = self._hall.along(view.pose.heading_rad)
        left = replace(view.pose, heading_rad=wrap_angle(heading_rad + pi / 2))
        if self._imaging is not None and self._imaging.shows_new(view.grid, left):
            # The wall ahead, of a dead end most often: it costs a turn now, and a whole path later
            self._imaging.settle(view.grid, left)
            self._look(left.heading_rad, view.now_s, then_rad=heading_rad)
        else:
            self._look(view.pose.heading_rad, view.now_s)

    def _follow_path(self, view: View) -> Motion:
        pose = view.pose
        stand = Motion(Speed.STOP, pose.heading_rad)
        if not self.path:
            mode = self.mode
            self._deliberate(self._plan_path(view))
            if self.mode is not mode or not self.path:
                return stand
        if self.mode is Mode.ROUTE and not self._frontiers.something_near(*self._target):
            self._look(pose.heading_rad, view.now_s)
            return stand
        if arrived(self.path, pose):
            self._arrive(view)
            return stand
        if not self._frontiers.is_clear(view, self.path):
            self.path = []
            return stand
        self.path = rest_of(self.path, pose)
        heading_rad = atan2(self.path[0][1] - pose.y_m, self.path[0][0] - pose.x_m)
        speed = speed_along(self.path, pose, heading_rad, view.grid)
        if speed is Speed.HIGH and self._imaging is not None:
            # Decision 1: slowly wherever the wall on the right was not seen yet
            speed = Speed.MEDIUM if self._imaging.worth_going_on(view.grid, pose, heading_rad) else speed
        return Motion(speed, heading_rad)

    def _plan_path(self, view: View) -> Work[None]:
        """A path for the present mode, or another mode where there is none (now)."""
        if self.mode is Mode.ROUTE:
            yield from self._choose(view)
            return
        target = (0.0, 0.0) if self.mode is Mode.HOME else self._target
        exact = self.mode is Mode.HOME or view.grid.stands(*target)
        around = view.grid.around(*target, GOAL_NEAR_CELLS if exact else GOAL_FAR_CELLS)
        route = yield from self._frontiers.route(view, around)
        if route is None and self.mode in (Mode.RETAKE, Mode.IMAGE):
            if self.mode is Mode.IMAGE:
                self._give_path_up(view)
            self._look(view.pose.heading_rad, view.now_s)
        elif route is None:
            self._retry_mode, self._retry_s = self.mode, view.now_s + RETRY_S
            self.mode = Mode.STUCK
        else:
            self.path = [*route[:-1], target] if exact else route

    def _arrive(self, view: View) -> None:
        self.path = []
        self._obstructions = 0
        if self.mode is Mode.HOME:
            self.mode, self._align_until_s = Mode.ALIGN, view.now_s + TURN_TIMEOUT_S
            return
        if self.mode is Mode.GOTO:
            self.mode = Mode.DONE
            return
        if self.mode is Mode.RETAKE:
            self._look(self._retake_rad, view.now_s)
            return
        if self.mode is Mode.IMAGE:
            self._look(self._wall_rad, view.now_s)
            self._wall_due = True
            return
        direction = frontiers.unknown_direction_rad(view.grid, view.pose.x_m, view.pose.y_m, view.pose.heading_rad)
        self._frontiers.mark_visited(*self._target)
        self._look(self._hall.along(direction), view.now_s)
