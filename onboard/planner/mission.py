"""The mission: explore by the right-hand rule and the list of side halls, come home, stop.

A state machine that is asked ten times a second for the motion it wants, given pose, grid, wall points and distances.
It knows no messages and no clock of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import atan2, cos, hypot, inf, pi, radians, sin

import numpy as np

from common.geometry import Points, Pose2, wrap_angle
from common.messages import Speed
from onboard.planner import exploration
from onboard.planner.exploration import Cells, Exploration, Frontier, FrontierGroup, as_set
from onboard.planner.grid_map import Cell, GridMap, Mask
from onboard.planner.hall_following import STEER_MAX_RAD, HallFollowing
from onboard.planner.right_hand_rule import Turn, decide
from onboard.planner.route_planning import cheapest_way
from onboard.planner.setbacks import Obstacles, Stillness, TriedWays
from onboard.planner.wall_imaging import WallImaging, beginning
from onboard.planner.way_following import Way, arrived, rest_of, speed_along

FRONT_STOP_M = 0.5  # from the ring's centre: straight driving ends here
LOOK_S = 1.2  # standing after a turn, for ranges and grid to catch up
REST_EVERY_S = 30.0  # of motion, for the gyro's bias
REST_S = 1.3
HEADING_REACHED_RAD = radians(3.0)
TURN_TIMEOUT_S = 12.0
BLOCK_AHEAD_M = 0.45
RETRY_S = 3.0
GOAL_NEAR_CELLS = 1  # of the grid, around a place to drive to
GOAL_FAR_CELLS = 4  # where the hull cannot stand at the place itself
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
    IMAGE = "driving to a wall that the camera has not seen"
    ALONG_WALL = "following a wall that the camera has not seen"
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

    def __init__(self, images_walls: bool = False) -> None:
        """`images_walls`: there is a camera, and every wall shall have been on its right."""
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
        self._look_next_rad: float | None = None
        self._target: tuple[float, float] = (0.0, 0.0)
        self._moving_s = 0.0
        self._rest_until_s = -inf
        self._last_s: float | None = None
        self._obstacles = Obstacles()
        self._tried = TriedWays()
        self._stillness = Stillness()
        self._imaging = WallImaging() if images_walls else None
        self._wall_rad = 0.0  # heading for the next leg along a wall
        self._wall_due = False  # that leg comes next
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
        if self.mode in (Mode.STRAIGHT, Mode.ROUTE, Mode.LOOK, Mode.IMAGE, Mode.ALONG_WALL):
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
        if self.mode in (Mode.STRAIGHT, Mode.ALONG_WALL):
            self._end_leg(view)
        elif self._visiting and hypot(self._target[0] - x_m, self._target[1] - y_m) < OBSTRUCTION_NEAR_M:
            self._obstructions += 1
            if self._obstructions >= OBSTRUCTIONS_MAX:
                self._obstructions = 0
                self._give_way_up(view)
                self._look(view.pose.heading_rad, view.now_s)
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
        if self._imaging is not None:
            self._imaging.look(view.grid, view.pose)
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
        if self._stillness.stagnates(view.pose, dt_s, under_way=self._visiting):
            self._give_way_up(view)
            self._grid_seen = -1
            self._look(view.pose.heading_rad, view.now_s)
            return stand
        if self.mode in (Mode.WAITING, Mode.DONE):
            return stand
        if self.mode is Mode.LOOK:
            return self._stand_and_look(view)
        if self.mode is Mode.STRAIGHT:
            return self._drive_straight(view)
        if self.mode is Mode.ALONG_WALL:
            return self._drive_along_wall(view)
        if self.mode is Mode.ALIGN:
            if abs(wrap_angle(view.pose.heading_rad)) < HEADING_REACHED_RAD or view.now_s > self._align_until_s:
                self.mode = Mode.DONE
            return Motion(Speed.STOP, 0.0)
        if self.mode is Mode.STUCK:
            if view.now_s >= self._retry_s:
                self.mode = self._retry_mode
            return stand
        return self._follow_way(view)

    @property
    def _visiting(self) -> bool:
        """Under way to a place of its own choice, which it may give up."""
        return self.mode in (Mode.ROUTE, Mode.IMAGE)

    def _give_way_up(self, view: View) -> None:
        if self.mode is Mode.IMAGE and self._imaging is not None:
            self._imaging.settle(view.grid, Pose2(*self._target, self._wall_rad))
        else:
            self._exploration.put_off(*self._target)

    def _look(self, heading_rad: float, now_s: float, then_rad: float | None = None) -> None:
        self.mode, self.way, self._wall_due, self._look_next_rad = Mode.LOOK, [], False, then_rad
        self._look_rad, self._look_since_s, self._look_settled_s = heading_rad, now_s, inf

    def _stand_and_look(self, view: View) -> Motion:
        off_rad = abs(wrap_angle(self._look_rad - view.pose.heading_rad))
        if off_rad < HEADING_REACHED_RAD and self._look_settled_s == inf:
            self._look_settled_s = view.now_s
        late = view.now_s - self._look_since_s > TURN_TIMEOUT_S
        if late or view.now_s - self._look_settled_s > LOOK_S:
            if self._look_next_rad is not None:
                self._look(self._look_next_rad, view.now_s)
            else:
                self._choose(view)
        return Motion(Speed.STOP, self._look_rad)

    def _choose(self, view: View) -> None:
        """P3.0: the right-most way that shows something new, back out of a dead end, else the next of the list."""
        if self._wall_due:
            self.mode, self._wall_due = Mode.ALONG_WALL, False
            self._hall.begin(view.pose, self._wall_rad)
            return
        heading_rad = self._hall.along(view.pose.heading_rad)
        if self._stands_askew(view.pose, heading_rad):
            self._look(heading_rad, view.now_s)
            return
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

    def _stands_askew(self, pose: Pose2, heading_rad: float) -> bool:
        """Does it have to turn to the hall's direction before it can judge the ways, and has not tried to yet?"""
        tried = self.mode is Mode.LOOK and abs(wrap_angle(heading_rad - self._look_rad)) < HEADING_REACHED_RAD
        return abs(wrap_angle(heading_rad - pose.heading_rad)) > STEER_MAX_RAD and not tried

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
        elif self._set_out_to_a_wall(view):
            return True
        else:
            self.go_home()
        return False

    def _set_out_to_a_wall(self, view: View) -> bool:
        """The nearest stretch of wall that the camera has not seen, from its beginning; False where there is none."""
        spots = self._imaging.spots(view.grid) if self._imaging is not None else {}
        route = self._route(view, set(spots)) if spots else None
        if route is None:
            return False
        first = beginning(spots, view.grid, view.grid.cell(*route[-1]))
        route = self._route(view, {first}) or route
        self.mode, self.way, self._target = Mode.IMAGE, route, route[-1]
        self._wall_rad = self._hall.along(spots[view.grid.cell(*route[-1])])
        return True

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

    def _drive_along_wall(self, view: View) -> Motion:
        pose = view.pose
        assert self._imaging is not None
        self._imaging.settle(view.grid, pose)
        self._hall.see(view.points, pose)
        leg_rad = self._hall.heading_rad
        reach_m = exploration.straight_reach_m(view.grid, pose, leg_rad, self._blocked)
        if (
            self._front_is_near(view)
            or reach_m < exploration.STRAIGHT_MIN_M
            or not self._imaging.worth_going_on(view.grid, pose, leg_rad)
        ):
            self._end_leg(view)
            return Motion(Speed.STOP, pose.heading_rad)
        return Motion(Speed.MEDIUM, self._hall.steered_rad(pose, view.left_m, view.right_m))

    def _end_leg(self, view: View) -> None:
        self._tried.add_leg(self._hall.start, view.pose)
        self._at_junction = True
        heading_rad = self._hall.along(view.pose.heading_rad)
        left = _facing(view.pose, wrap_angle(heading_rad + pi / 2))
        if self._imaging is not None and self._imaging.shows_new(view.grid, left):
            # The wall ahead, of a dead end most often: it costs a turn now, and a whole way later
            self._imaging.settle(view.grid, left)
            self._look(left.heading_rad, view.now_s, then_rad=heading_rad)
        else:
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
        speed = speed_along(self.way, pose, heading_rad, view.grid)
        if speed is Speed.HIGH and self._imaging is not None:
            # Decision 1: slowly wherever the wall on the right was not seen yet
            speed = Speed.MEDIUM if self._imaging.worth_going_on(view.grid, pose, heading_rad) else speed
        return Motion(speed, heading_rad)

    def _plan_way(self, view: View) -> bool:
        """A way for the present mode; False where there is none (now)."""
        if self.mode is Mode.ROUTE:
            self._choose(view)
            return self.mode is Mode.ROUTE and bool(self.way)
        target = (0.0, 0.0) if self.mode is Mode.HOME else self._target
        exact = self.mode is Mode.HOME or view.grid.stands(*target)
        route = self._route(view, view.grid.around(*target, GOAL_NEAR_CELLS if exact else GOAL_FAR_CELLS))
        if route is None and self.mode in (Mode.RETAKE, Mode.IMAGE):
            if self.mode is Mode.IMAGE:
                self._give_way_up(view)
            self._look(view.pose.heading_rad, view.now_s)
            return False
        if route is None:
            self._retry_mode, self._retry_s = self.mode, view.now_s + RETRY_S
            self.mode = Mode.STUCK
            return False
        self.way = [*route[:-1], target] if exact else route
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
        if self.mode is Mode.IMAGE:
            self._look(self._wall_rad, view.now_s)
            self._wall_due = True
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
