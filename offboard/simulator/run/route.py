"""A scripted drive in place of the Planner, for benchmarks: along the centrelines of a floor, or all of its walls.

It knows the floor and the true pose; other modules receive drive commands from it and nothing else. Along centrelines:
every hall's middle at least once, the nearest one not yet driven first, then back to the start. Along walls:
`wall_route.py`. It stands still every few seconds for the zero-velocity update of the gyro, as the Planner does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from common.bus import Bus, alive_and_valid
from common.constants import POSE_RATE_HZ
from common.errors import ErrorCode
from common.geometry import Points, Pose2, wrap_angle
from common.messages.mission import Operation, Outcome, PlannerView
from common.messages.motion import DriveCommand, Speed
from common.messages.topics import DRIVE, ODOMETRY, OPERATION, PERMIT, PLAN, Topic
from common.status import StatusReporter
from offboard.simulator.building.floor import Floor
from offboard.simulator.run.free_floor import CELL_M, STEPS, FreeFloor, Mask, path_to
from offboard.simulator.run.wall_route import Looks, route_along_walls
from onboard.planner.driving.looking import Looking
from onboard.planner.driving.net_rotation_balancing import NetRotationBalancing
from onboard.planner.driving.zero_velocity_update import ZeroVelocityUpdate

CENTRELINES, WALLS = "centrelines", "walls"
ROUTES = CENTRELINES, WALLS
DRIVEN_M = 1.0  # a middle within this of the path is driven
DRIVEN_SHARE = 1.5  # and, in a wide place, within so many times the path's own distance from the wall
LOOK_AHEAD_M = 0.5
ARRIVED_M = 0.15
THEN_CELLS = 15  # how far along the path the turn after this one is taken from
SIGHT = 12  # points of a straight line to a place that is not far; less than a cell apart
VIEW_PERIOD_S = 0.5


def path_through_middles(free: FreeFloor, start: Points) -> Points:
    """(N, 2) in metres, from `start` (2,) through all halls that can be reached, and back."""
    here = home = free.nearest(start)
    left = _ridge(free)[free.open]
    reach_m = np.maximum(DRIVEN_SHARE * free.clearance_m[free.open], DRIVEN_M)
    path = [here]
    while True:
        costs, before = free.costs_from(here)
        left &= np.isfinite(costs)
        goal = int(np.where(left, costs, np.inf).argmin()) if left.any() else home
        leg = path_to(goal, here, before)
        path += leg[1:]
        if not left.any():
            places: Points = free.places[path]
            return places
        for node in leg:
            left &= np.hypot(*(free.places - free.places[node]).T) > reach_m[node]
        left[goal] = False
        here = goal


def _ridge(free: FreeFloor) -> Mask:
    """Open cells that lie further from the walls than their neighbours on both sides, along some line."""
    c = np.pad(free.clearance_m, 2)
    rows, columns = free.clearance_m.shape
    here = free.clearance_m
    ridge = np.zeros(free.open.shape, bool)
    for dy, dx in STEPS:
        one = c[2 + 2 * dy : 2 + 2 * dy + rows, 2 + 2 * dx : 2 + 2 * dx + columns]
        other = c[2 - 2 * dy : 2 - 2 * dy + rows, 2 - 2 * dx : 2 - 2 * dx + columns]
        ridge |= (here > one) & (here > other)
    return ridge & free.open


def planned_route(name: str, floor: Floor, free: FreeFloor, start: Points) -> tuple[Points, Looks]:
    """Places (N, 2) of the route of that name, and the stops at them."""
    if name == WALLS:
        return route_along_walls(floor, free, start)
    return path_through_middles(free, start), {}


class RouteDriver:
    """Node in the Planner's place; `true_pose` gives the simulation's true pose."""

    name = "planner"
    period_s = 1.0 / POSE_RATE_HZ
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(self, route: str, floor: Floor, true_pose: Callable[[], Pose2]) -> None:
        """`route`: one of ROUTES."""
        self._true_pose = true_pose
        pose = true_pose()
        self._free = FreeFloor(floor)
        self._path, self._looks = planned_route(route, floor, self._free, np.array([pose.x_m, pose.y_m]))
        self._at = 0
        self._looking: Looking | None = None
        self._started = False
        self._commanded = DriveCommand(0.0, 0, Speed.MEDIUM, 0.0)
        self._zero_velocity = ZeroVelocityUpdate()
        self._net_rotation = NetRotationBalancing()
        self._view_due_s = 0.0
        self._status = StatusReporter(self.name)

    @property
    def finished(self) -> bool:
        return self._at >= len(self._path)

    def step(self, bus: Bus, now_s: float) -> None:
        self._started |= any(o.operation is Operation.START for o in bus.take(OPERATION))
        permit, odometry = bus.latest(PERMIT), bus.latest(ODOMETRY)
        if odometry is not None and alive_and_valid(bus, ODOMETRY):
            pose = self._true_pose()
            drives = self._started and permit is not None and permit.granted and not self.finished
            pauses = self._zero_velocity.due(now_s, odometry.standing)
            goal = self._goal(pose, now_s) if drives and not pauses else None
            if goal is not None:
                self._command(now_s, Speed.MEDIUM, odometry.yaw_rad + self._turn_rad(pose, goal, odometry.yaw_rad))
            elif self._looking is not None and drives and not pauses:
                turn_rad = wrap_angle(self._looking.heading_rad - pose.heading_rad)
                turn_rad = self._net_rotation.turn_rad(odometry.yaw_rad, turn_rad)
                self._command(now_s, Speed.STOP, odometry.yaw_rad + turn_rad)
            elif self._commanded.speed is not Speed.STOP:
                self._command(now_s, Speed.STOP, odometry.yaw_rad)
            bus.publish(DRIVE, replace(self._commanded, t_s=now_s))
        self._status.report(bus, now_s, state="ROUTE", error=ErrorCode.OK, ready=True)
        if now_s >= self._view_due_s:
            self._view_due_s = now_s + VIEW_PERIOD_S
            ahead = self._path[self._at :].astype(np.float32)
            detail = (
                "scripted route driven" if self.finished else f"{len(ahead) * CELL_M:.0f} m of scripted route ahead"
            )
            outcome = Outcome.FINISHED if self.finished else Outcome.NONE
            bus.publish(PLAN, PlannerView(now_s, "ROUTE", detail, ahead[:200], 0, 0.0, outcome))

    def close(self) -> None:
        """Nothing is held open."""

    def _command(self, now_s: float, speed: Speed, yaw_rad: float) -> None:
        self._commanded = DriveCommand(now_s, self._commanded.command_id + 1, speed, wrap_angle(yaw_rad))

    def _turn_rad(self, pose: Pose2, goal: tuple[float, float], yaw_rad: float) -> float:
        """The turn to the goal, in the sense of rotation that suits the next turn of the path."""
        turn_rad = pose.bearing_rad(*goal)
        later_x_m, later_y_m = self._path[min(self._at + THEN_CELLS, len(self._path) - 1)].tolist()
        then_rad = Pose2(*goal, pose.heading_rad + turn_rad).bearing_rad(later_x_m, later_y_m)
        return self._net_rotation.turn_rad(yaw_rad, turn_rad, then_rad)

    def _goal(self, pose: Pose2, now_s: float) -> tuple[float, float] | None:
        """The next place of the path that is far enough ahead to steer for; None at its end, and while it stands at a
        stop, to which it drives up."""
        while self._at < len(self._path):
            x_m, y_m = self._path[self._at].tolist()
            stops = self._at in self._looks or self._at == len(self._path) - 1
            away_m = np.hypot(x_m - pose.x_m, y_m - pose.y_m)
            # The next place may be in sight only from this one, round a corner
            far = away_m > LOOK_AHEAD_M or (away_m > ARRIVED_M and (stops or not self._leads_to_next(pose)))
            if far and self._looking is None:
                return x_m, y_m
            if self._at in self._looks and not self._looked(pose, now_s):
                return None
            self._at += 1
        return None

    def _leads_to_next(self, pose: Pose2) -> bool:
        """Whether the floor is open straight from the robot to the next place of the path."""
        here, there = np.array([pose.x_m, pose.y_m]), self._path[self._at + 1]
        return bool(self._free.is_open(here + np.linspace(0.0, 1.0, SIGHT)[:, None] * (there - here)).all())

    def _looked(self, pose: Pose2, now_s: float) -> bool:
        """Whether it has stood at this stop as long as it has to, in the stop's heading."""
        if self._looking is None:
            self._looking = Looking()
            self._looking.begin(self._looks[self._at], now_s)
        if not self._looking.over(pose, now_s):
            return False
        self._looking = None
        return True
