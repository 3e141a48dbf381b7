"""The mission: explore by the right-hand rule and the list of side halls, come home, stop.

A state machine that is asked ten times a second for the motion it wants, given pose, grid, wall points and distances.
It knows no messages and no clock of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import atan2, cos, hypot, inf, radians, sin

import numpy as np

from common.geometry import Points, Pose2, wrap_angle
from common.messages import Speed
from onboard.planner import exploration
from onboard.planner.exploration import Cells, Exploration, Frontier, FrontierGroup, as_set
from onboard.planner.grid_map import Cell, GridMap, Mask
from onboard.planner.hall_following import HallFollowing
from onboard.planner.right_hand_rule import Turn, decide
from onboard.planner.route_planning import cheapest_way
from onboard.planner.setbacks import Obstacles, Stillness, TriedWays
from onboard.planner.way_following import Way, arrived, rest_of, speed_along

FRONT_STOP_M = 0.5  # from the ring's centre: straight driving ends here
LOOK_S = 1.2  # standing after a turn, for ranges and grid to catch up
REST_EVERY_S = 30.0  # of motion, for the gyro's bias
REST_S = 1.3
HEADING_REACHED_RAD = radians(3.0)
TURN_TIMEOUT_S = 12.0
BLOCK_AHEAD_M = 0.45
RETRY_S = 3.0
LIST_PATIENCE = 3  # grids without any reachable frontier before the floor counts as done
OBSTRUCTIONS_MAX = 2  # next to where it wants to get, then that is given up
OBSTRUCTION_NEAR_M = 1.5
SIDE_REACH_M = 1.2
SIDE_WIDTH_M = 0.8


class Mode(Enum):
    """What the mission is about; the value is what people are told."""

    WAITING = "waiting for start"
    STRAIGHT = "following the hall"
    ROUTE = "driving to a side hall"
    LOOK = "looking"
    HOME = "driving home"
    ALIGN = "home, turning to the first heading"
    GOTO = "driving to a place"
    RETAKE = "driving to where a photo is wanted"
    DONE = "done"
    STUCK = "no way out; waiting"


@dataclass(frozen=True, slots=True)
class Motion:
    """What the mission wants of the Carrier: a speed and a heading in the map."""

    speed: Speed
    heading_rad: float


@dataclass(frozen=True, slots=True)
class View:
    """What the mission sees in one tick: `points` (N, 2) of walls near the robot, distances from the ring's centre.

    NaN = no echo; `grid_revision` grows with every new grid.
    """

    now_s: float
    pose: Pose2
    grid: GridMap
    grid_revision: int
    points: Points
    left_m: float
    right_m: float
    front_m: float


class Mission:
    """`step` returns the wanted motion; `mode`, `groups` and `way` tell people what it is about."""

    def __init__(self) -> None:
        self.mode = Mode.WAITING
        self.groups: list[FrontierGroup] = []
        self.way: Way = []
        self._exploration = Exploration()
        self._frontier: Frontier = exploration.NOWHERE
        self._blocked: Mask = np.zeros((0, 0), dtype=bool)
        self._grid_seen = -1
        self._hall = HallFollowing()
        self._look_rad = 0.0
        self._look_since_s = 0.0
        self._look_settled_s = inf
        self._target: tuple[float, float] = (0.0, 0.0)
        self._moving_s = 0.0
        self._rest_until_s = -inf
        self._last_s: float | None = None
        self._obstacles = Obstacles()
        self._tried = TriedWays()
        self._stillness = Stillness()
        self._empty_lists = 0
        self._obstructions = 0  # since the last arrival
        self._at_junction = False  # a leg has ended, and no way on is chosen yet
        self._retake_rad = 0.0
        self._retry_s = 0.0
        self._retry_mode = Mode.HOME
        self._align_until_s = 0.0

    @property
    def finished(self) -> bool:
        return self.mode is Mode.DONE

    def start(self, pose: Pose2, now_s: float) -> None:
        """Begin to explore; once more from the beginning of the list after a finished mission."""
        if self.mode in (Mode.WAITING, Mode.DONE):
            self._empty_lists = 0
            self._look(pose.heading_rad, now_s)

    def go_home(self) -> None:
        """Give up what is left of the list."""
        self.mode, self.way = Mode.HOME, []

    def go_to(self, x_m: float, y_m: float) -> None:
        """Drive to a place on the map, and stay there."""
        self.mode, self.way, self._target = Mode.GOTO, [], (x_m, y_m)

    def detour(self, pose: Pose2) -> None:
        """Stand at a pose for another photo, then go on exploring."""
        if self.mode in (Mode.STRAIGHT, Mode.ROUTE, Mode.LOOK):
            self.mode, self.way, self._target = Mode.RETAKE, [], (pose.x_m, pose.y_m)
            self._retake_rad = pose.heading_rad

    def end_detour(self, heading_rad: float, now_s: float) -> None:
        """Nobody wants that photo any more."""
        if self.mode is Mode.RETAKE:
            self._look(heading_rad, now_s)

    def blocked(self, view: View, bearing_rad: float) -> None:
        """Something stands in the way that the map does not know: plan around it for a while."""
        angle = view.pose.heading_rad + bearing_rad
        x_m, y_m = view.pose.x_m + BLOCK_AHEAD_M * cos(angle), view.pose.y_m + BLOCK_AHEAD_M * sin(angle)
        self._obstacles.add(x_m, y_m, view.now_s)
        # Most often this is a wall that was met at a slant and not yet placed: nothing is to be found behind it
        self._exploration.put_off(x_m, y_m)
        if self.mode is Mode.STRAIGHT:
            self._end_leg(view)
        elif self.mode is Mode.ROUTE and hypot(self._target[0] - x_m, self._target[1] - y_m) < OBSTRUCTION_NEAR_M:
            self._obstructions += 1
            if self._obstructions >= OBSTRUCTIONS_MAX:
                self._obstructions = 0
                self._exploration.put_off(*self._target)
        self.way = []
        self._grid_seen = -1

    def step(self, view: View) -> Motion:
        """The motion that is wanted now; with rests in between for the gyro."""
        dt_s = view.now_s - self._last_s if self._last_s is not None else 0.0
        self._last_s = view.now_s
        self._obstacles.forget(view.now_s)
        if view.grid_revision != self._grid_seen:
            self._grid_seen = view.grid_revision
            self._blocked = self._obstacles.mask(view.grid)
            self._frontier = self._exploration.frontier(view.grid, self._blocked)
            self.groups = exploration.groups(view.grid, self._frontier)
        if view.now_s < self._rest_until_s:
            return Motion(Speed.STOP, view.pose.heading_rad)
        motion = self._act(view, dt_s)
        if motion.speed is Speed.STOP:
            return motion
        self._moving_s += dt_s
        if self._moving_s > REST_EVERY_S:
            self._moving_s = 0.0
            self._rest_until_s = view.now_s + REST_S
        return motion

    def _act(self, view: View, dt_s: float) -> Motion:
        stand = Motion(Speed.STOP, view.pose.heading_rad)
        if self._stillness.stagnates(view.pose, dt_s, under_way=self.mode is Mode.ROUTE):
            self._exploration.put_off(*self._target)
            self._grid_seen = -1
            self._look(view.pose.heading_rad, view.now_s)
            return stand
        if self.mode in (Mode.WAITING, Mode.DONE):
            return stand
        if self.mode is Mode.LOOK:
            return self._stand_and_look(view)
        if self.mode is Mode.STRAIGHT:
            return self._drive_straight(view)
        if self.mode is Mode.ALIGN:
            if abs(wrap_angle(view.pose.heading_rad)) < HEADING_REACHED_RAD or view.now_s > self._align_until_s:
                self.mode = Mode.DONE
            return Motion(Speed.STOP, 0.0)
        if self.mode is Mode.STUCK:
            if view.now_s >= self._retry_s:
                self.mode = self._retry_mode
            return stand
        return self._follow_way(view)

    def _look(self, heading_rad: float, now_s: float) -> None:
        self.mode, self.way = Mode.LOOK, []
        self._look_rad, self._look_since_s, self._look_settled_s = heading_rad, now_s, inf

    def _stand_and_look(self, view: View) -> Motion:
        off_rad = abs(wrap_angle(self._look_rad - view.pose.heading_rad))
        if off_rad < HEADING_REACHED_RAD and self._look_settled_s == inf:
            self._look_settled_s = view.now_s
        late = view.now_s - self._look_since_s > TURN_TIMEOUT_S
        if late or view.now_s - self._look_settled_s > LOOK_S:
            self._choose(view)
        return Motion(Speed.STOP, self._look_rad)

    def _choose(self, view: View) -> None:
        """P3.0: the right-most way that shows something new, back out of a dead end, else the next of the list."""
        heading_rad = self._hall.along(view.pose.heading_rad)
        ways = {turn: self._hall.along(wrap_angle(heading_rad + turn.value)) for turn in Turn}
        open_ways = {turn for turn, way_rad in ways.items() if self._shows_new(view, way_rad, turn is Turn.FORWARD)}
        # A way that was chosen is driven before the next choice, or the robot would go round and round on the spot
        turn = Turn.FORWARD if Turn.FORWARD in open_ways and not self._at_junction else decide(open_ways)
        self._at_junction = False
        if turn is Turn.FORWARD:
            self.mode, self._empty_lists = Mode.STRAIGHT, 0
            self._hall.begin(view.pose, heading_rad)
        elif turn in open_ways:
            self._tried.add_side(_facing(view.pose, ways[turn]))
            self._look(ways[turn], view.now_s)
        else:
            self._take_from_list(view)

    def _shows_new(self, view: View, way_rad: float, forward: bool) -> bool:
        """Would driving straight that way show new floor? To a side only what lies near the axis counts."""
        side = _facing(view.pose, way_rad)
        reach_m = exploration.straight_reach_m(view.grid, side, way_rad, self._blocked)
        if forward:
            ruled_out = self._front_is_near(view) or self._tried.leg_in_vain(view.pose)
            width_m = exploration.STRAIGHT_SIDE_M
        else:
            ruled_out = reach_m < SIDE_REACH_M or self._tried.tried(side)
            width_m = SIDE_WIDTH_M
        return not ruled_out and exploration.something_ahead(view.grid, self._frontier, side, way_rad, reach_m, width_m)

    def _take_from_list(self, view: View, cells: Cells | None = None) -> bool:
        """Set out for the nearest of these cells, or of the whole list; False where no way leads there."""
        wanted = exploration.roomy_cells(view.grid, self.groups) if cells is None else as_set(cells)
        route = self._route(view, wanted) if wanted else None
        if route is not None:
            self._empty_lists = 0
            self.mode, self.way = Mode.ROUTE, route
            self._target = route[-1]
            return True
        if cells is not None:
            return False
        # What stands in the way may hide a way: nothing is concluded before it is forgotten
        self._empty_lists += 0 if self._obstacles.may_hide_a_way(view.now_s) else 1
        if self._empty_lists < LIST_PATIENCE or self._exploration.try_again():
            self._grid_seen = -1
            self._look(view.pose.heading_rad, view.now_s)
        else:
            self.go_home()
        return False

    def _route(self, view: View, wanted: set[Cell]) -> Way | None:
        """Way points to the cheapest of the wanted cells; None where no way leads there."""
        return cheapest_way(view.grid, view.pose, wanted, self._obstacles.mask(view.grid))

    def _front_is_near(self, view: View) -> bool:
        return view.front_m < FRONT_STOP_M

    def _drive_straight(self, view: View) -> Motion:
        pose = view.pose
        self._hall.see(view.points, pose)
        opening = self._hall.opening_passed(view.grid, self._frontier, pose)
        if opening is not None and self._take_from_list(view, opening):
            return Motion(Speed.STOP, pose.heading_rad)
        leg_rad = self._hall.heading_rad
        reach_m = exploration.straight_reach_m(view.grid, pose, leg_rad, self._blocked)
        if self._front_is_near(view) or not exploration.something_ahead(
            view.grid, self._frontier, pose, leg_rad, reach_m
        ):
            self._end_leg(view)
            return Motion(Speed.STOP, pose.heading_rad)
        return Motion(Speed.MEDIUM, self._hall.steered_rad(pose, view.left_m, view.right_m))

    def _end_leg(self, view: View) -> None:
        self._tried.add_leg(self._hall.start, view.pose)
        self._at_junction = True
        self._look(view.pose.heading_rad, view.now_s)

    def _follow_way(self, view: View) -> Motion:
        pose = view.pose
        stand = Motion(Speed.STOP, pose.heading_rad)
        if not self.way and not self._plan_way(view):
            return stand
        if self.mode is Mode.ROUTE and not self._still_wanted(view):
            self._look(pose.heading_rad, view.now_s)
            return stand
        if arrived(self.way, pose):
            self._arrive(view)
            return stand
        if not self._way_is_clear(view):
            self.way = []
            return stand
        self.way = rest_of(self.way, pose)
        heading_rad = atan2(self.way[0][1] - pose.y_m, self.way[0][0] - pose.x_m)
        return Motion(speed_along(self.way, pose, heading_rad, view.grid), heading_rad)

    def _plan_way(self, view: View) -> bool:
        """A way for the present mode; False where there is none (now)."""
        if self.mode is Mode.ROUTE:
            self._choose(view)
            return self.mode is Mode.ROUTE and bool(self.way)
        target = (0.0, 0.0) if self.mode is Mode.HOME else self._target
        goal = view.grid.cell(*target)
        reach = 1 if self.mode is Mode.HOME else 4
        span = range(-reach, reach + 1)
        wanted = {(goal[0] + i, goal[1] + j) for i in span for j in span}
        route = self._route(view, wanted)
        if route is None and self.mode is Mode.RETAKE:
            self._look(view.pose.heading_rad, view.now_s)
            return False
        if route is None:
            self._retry_mode, self._retry_s = self.mode, view.now_s + RETRY_S
            self.mode = Mode.STUCK
            return False
        self.way = [*route[:-1], target] if self.mode is Mode.HOME else route
        return True

    def _still_wanted(self, view: View) -> bool:
        """Is there still frontier near the end of the way?"""
        gap = self._frontier.points - np.array(self._target)
        return bool((np.hypot(gap[:, 0], gap[:, 1]) < 0.5).any())

    def _arrive(self, view: View) -> None:
        self.way = []
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
        direction = exploration.unknown_direction_rad(view.grid, view.pose.x_m, view.pose.y_m, view.pose.heading_rad)
        self._exploration.give_up(*self._target)
        self._look(self._hall.along(direction), view.now_s)

    def _way_is_clear(self, view: View) -> bool:
        """Nothing that was met stands on the next two legs, and no wall was seen on the next."""
        here = (view.pose.x_m, view.pose.y_m)
        on_legs = any(self._obstacles.on_leg(a, b) for a, b in pairwise([here, *self.way[:2]]))
        return not on_legs and view.grid.sees(here, self.way[0])


def _facing(pose: Pose2, heading_rad: float) -> Pose2:
    return Pose2(pose.x_m, pose.y_m, heading_rad)
