"""A scripted drive along the centrelines of a floor, for mapping benchmarks: it takes the place of the Planner.

It knows the floor and the true pose; other modules receive drive commands from it and nothing else. The path: every
hall's middle at least once, the nearest one not yet driven first, then back to the start. It stands still every few
seconds for the zero-velocity update of the gyro, as the Planner does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from common.bus import Bus, alive_and_valid
from common.constants import FOOTPRINT_RADIUS_M, PLANNER_CLEARANCE_M, POSE_RATE_HZ
from common.errors import ErrorCode
from common.geometry import Points, Pose2, wrap_angle
from common.messages.mission import Operation, Outcome, PlannerView
from common.messages.motion import DriveCommand, Speed
from common.messages.topics import DRIVE, ODOMETRY, OPERATION, PERMIT, PLAN, Topic
from common.status import StatusReporter
from offboard.simulator.building.floor import Floor
from onboard.planner.driving.net_rotation_balancing import NetRotationBalancing
from onboard.planner.driving.zero_velocity_update import ZeroVelocityUpdate

CELL_M = 0.1
MIDDLE_WEIGHT = 6.0  # extra cost of a metre at a wall, in metres
CLEARANCE_M = FOOTPRINT_RADIUS_M + PLANNER_CLEARANCE_M
DRIVEN_M = 1.0  # a middle within this of the path is driven
DRIVEN_SHARE = 1.5  # and, in a wide place, within so many times the path's own distance from the wall
LOOK_AHEAD_M = 0.5
ARRIVED_M = 0.15
THEN_CELLS = 15  # how far along the path the turn after this one is taken from
VIEW_PERIOD_S = 0.5
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))

Mask = npt.NDArray[np.bool_]


class Middles:
    """The corridor in cells of 10 cm: which cells the robot can drive on, and which are the middle of a hall."""

    def __init__(self, floor: Floor) -> None:
        rings = [np.array(ring, dtype=np.float64) for ring in (floor.exterior, *floor.holes)]
        self._low = rings[0].min(axis=0) - 2 * CELL_M
        columns, rows = np.ceil((rings[0].max(axis=0) - self._low) / CELL_M).astype(int) + 3
        free = np.zeros((rows, columns), np.uint8)
        cv2.fillPoly(free, [np.round((ring - self._low) / CELL_M).astype(np.int32) for ring in rings], (1,))
        self.clearance_m = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5), dtype=np.float64) * CELL_M
        self._open: Mask = self.clearance_m >= CLEARANCE_M
        self._node = np.full(free.shape, -1)
        self._node[self._open] = np.arange(int(self._open.sum()))
        self._places = np.argwhere(self._open)[:, ::-1] * CELL_M + self._low
        self._graph = self._neighbour_graph()

    def _neighbour_graph(self) -> csr_matrix:
        """Neighbouring open cells as edges, weighted by the cost of driving between them."""
        price = 1.0 + MIDDLE_WEIGHT * np.exp(-self.clearance_m / 0.4)
        first, second, cost = [], [], []
        rows, columns = self._open.shape
        for dy, dx in _STEPS:
            here = np.s_[: rows - dy, max(-dx, 0) : columns - max(dx, 0)]
            there = np.s_[dy:, max(dx, 0) : columns - max(-dx, 0)]
            both = self._open[here] & self._open[there]
            first.append(self._node[here][both])
            second.append(self._node[there][both])
            cost.append(((price[here] + price[there]) / 2)[both] * CELL_M * float(np.hypot(dx, dy)))
        edges = np.concatenate(first), np.concatenate(second)
        return csr_matrix((np.concatenate(cost), edges), shape=(len(self._places),) * 2)

    def _ridge(self) -> Mask:
        """Open cells that lie further from the walls than their neighbours on both sides, along some line."""
        c = np.pad(self.clearance_m, 2)
        rows, columns = self.clearance_m.shape
        here = self.clearance_m
        ridge = np.zeros(self._open.shape, bool)
        for dy, dx in _STEPS:
            one = c[2 + 2 * dy : 2 + 2 * dy + rows, 2 + 2 * dx : 2 + 2 * dx + columns]
            other = c[2 - 2 * dy : 2 - 2 * dy + rows, 2 - 2 * dx : 2 - 2 * dx + columns]
            ridge |= (here > one) & (here > other)
        return ridge & self._open

    def path(self, start: Points) -> Points:
        """(N, 2) in metres, from `start` (2,) through all halls that can be reached, and back."""
        here = int(np.hypot(*(self._places - start).T).argmin())
        home = here
        left = self._ridge()[self._open]
        reach_m = np.maximum(DRIVEN_SHARE * self.clearance_m[self._open], DRIVEN_M)
        path = [here]
        while True:
            costs, befores = dijkstra(self._graph, directed=False, indices=[here], return_predecessors=True)
            cost, before = costs[0], befores[0]
            left &= np.isfinite(cost)
            goal = int(np.where(left, cost, np.inf).argmin()) if left.any() else home
            leg = [goal]
            while leg[-1] != here:
                leg.append(int(before[leg[-1]]))
            path += leg[-2::-1]
            if not left.any():
                places: Points = self._places[path]
                return places
            for node in leg:
                left &= np.hypot(*(self._places - self._places[node]).T) > reach_m[node]
            left[goal] = False
            here = goal


class RouteDriver:
    """Node in the Planner's place; `true_pose` gives the simulation's true pose."""

    name = "planner"
    period_s = 1.0 / POSE_RATE_HZ
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(self, floor: Floor, true_pose: Callable[[], Pose2]) -> None:
        self._true_pose = true_pose
        pose = true_pose()
        self._path = Middles(floor).path(np.array([pose.x_m, pose.y_m]))
        self._at = 0
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
            goal = self._goal(pose) if drives and not pauses else None
            if goal is not None or self._commanded.speed is not Speed.STOP:
                turn_rad = 0.0 if goal is None else self._turn_rad(pose, goal, odometry.yaw_rad)
                speed = Speed.STOP if goal is None else Speed.MEDIUM
                yaw_rad = wrap_angle(odometry.yaw_rad + turn_rad)
                self._commanded = DriveCommand(now_s, self._commanded.command_id + 1, speed, yaw_rad)
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

    def _turn_rad(self, pose: Pose2, goal: tuple[float, float], yaw_rad: float) -> float:
        """The turn to the goal, in the sense of rotation that suits the next turn of the path."""
        turn_rad = pose.bearing_rad(*goal)
        later_x_m, later_y_m = self._path[min(self._at + THEN_CELLS, len(self._path) - 1)].tolist()
        then_rad = Pose2(*goal, pose.heading_rad + turn_rad).bearing_rad(later_x_m, later_y_m)
        return self._net_rotation.turn_rad(yaw_rad, turn_rad, then_rad)

    def _goal(self, pose: Pose2) -> tuple[float, float] | None:
        """The next place of the path that is far enough ahead to steer for; None at its end."""
        while self._at < len(self._path):
            x_m, y_m = self._path[self._at].tolist()
            last = self._at == len(self._path) - 1
            if np.hypot(x_m - pose.x_m, y_m - pose.y_m) > (ARRIVED_M if last else LOOK_AHEAD_M):
                return x_m, y_m
            self._at += 1
        return None
