"""Node `ros`: map, pose, path, sonars and doors of the bus -> a graph of ROS 2; a goal or pose from there -> an order.

What is published and in which types stands in `offboard/export/ros_messages.py`, which writes bags too. An order takes
the path of the page's and the terminal's (`offboard/operate`), and only a program on this machine may give one: ROS
does not show who publishes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import Any, Protocol

from common.bus import Bus
from common.fields import COORDINATE
from common.geometry import principal_axes
from common.grid_cells import cells_of
from common.messages.mapping import GridUpdate
from common.messages.mission import Operation
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import GRID, POI, POSE, RANGES, TRAJECTORY, Topic
from common.pace import Pace
from common.plain_text import plain
from common.status import StatusReporter
from common.undecodable import Undecodable
from offboard.export import ros_messages
from offboard.export.ros_messages import MAP_FRAME, Sent
from offboard.export.run_time import NS
from offboard.operate.bus_operator import Operator, OperatorView
from offboard.operate.operations import Order
from offboard.ros.driven_path import DrivenPath
from offboard.ros.wall_time import WallTime

PATH_PERIOD_S = 2.0
DOORS_PERIOD_S = 1.0
DOORS_MAX = 500  # newest ones: each costs 100 us
_FRAME_MAX = 50

_log = logging.getLogger("ros")


@dataclass(frozen=True, slots=True)
class Goal:
    """Of `/goal_pose`: metres in the frame that it names. Where the robot shall look then is not taken."""

    frame: str
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class InitialPose:
    """Of `/initialpose`: where a person says that the robot is, with standard deviations."""

    frame: str
    x_m: float
    y_m: float
    heading_rad: float
    sd_m: float
    sd_heading_rad: float


def standard_deviations(covariance: Sequence[float]) -> tuple[float, float]:
    """Of the place along its worst direction, and of the heading; of 36 numbers as ROS has them. NaN where none are."""
    xx, xy, yy, heading = covariance[0], covariance[1], covariance[7], covariance[35]
    worst, _, _ = principal_axes(xx, xy, yy)
    return (sqrt(worst), sqrt(heading)) if worst >= 0.0 and heading >= 0.0 else (nan, nan)


class Graph(Protocol):
    """The side of ROS."""

    def publish(self, sent: Sent) -> None: ...

    def take_wishes(self) -> list[Goal | InitialPose]:
        """Every one since the last call, oldest first."""

    def close(self) -> None: ...


class Ros:
    """`wall_s`: seconds since 1970. `make_operator`: what takes orders, given who takes its views; None: nobody may
    order anything.
    """

    name = "ros"
    period_s = 0.05
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(
        self,
        graph: Graph,
        wall_s: Callable[[], float],
        make_operator: Callable[[Callable[[OperatorView], None]], Operator] | None = None,
    ) -> None:
        self._graph, self._wall_s = graph, wall_s
        self._operator = None if make_operator is None else make_operator(self.show)
        self._status = StatusReporter(self.name)
        self._undecodable = Undecodable()
        self._time = WallTime()
        self._path, self._path_changed = DrivenPath(), False
        self._doors: dict[int, PointOfInterest] = {}
        self._doors_changed = False
        self._grid: GridUpdate | None = None
        self._path_pace, self._doors_pace = Pace(PATH_PERIOD_S), Pace(DOORS_PERIOD_S)
        self._view = OperatorView()
        graph.publish(ros_messages.of_sonar_frames(0))
        if self._operator is not None:
            self._operator.open()

    def step(self, bus: Bus, now_s: float) -> None:
        for sent in self._news(bus, now_s):
            self._graph.publish(sent)
        for wish in self._graph.take_wishes():
            self._order(wish)
        self._status.report(bus, now_s, state="SERVING", ready=True, detail=self._detail())

    def show(self, view: OperatorView) -> None:
        """What became of an order; called by the operator's thread."""
        if view.answer and view.answer != self._view.answer:
            _log.info("%s", view.answer)
        self._view = view

    def close(self) -> None:
        if self._operator is not None:
            self._operator.close()
        self._graph.close()

    def _news(self, bus: Bus, now_s: float) -> Iterator[Sent]:
        wall_s, of = self._wall_s(), self._time.of
        for pose in bus.take(POSE):
            self._time.take(pose.t_s, wall_s)
            self._path_changed |= self._path.take_pose(pose)
            if pose.valid:
                yield from ros_messages.of_pose(of(pose.t_s), pose)
        for ranges in bus.take(RANGES):
            if ranges.valid:
                self._time.take(ranges.t_s, wall_s)
                yield from ros_messages.of_ranges(of(ranges.t_s), ranges)
        for trajectory in bus.take(TRAJECTORY)[-1:]:
            self._time.take(trajectory.t_s, wall_s)
            self._path.take_trajectory(trajectory)
            self._path_changed = True
        for poi in bus.take(POI):
            self._keep(poi)
        grid = bus.latest(GRID)
        if grid is not None and grid is not self._grid:
            self._grid = grid
            self._time.take(grid.t_s, wall_s)
            yield from self._map(grid)
        if self._path_changed and self._path_pace.due(now_s):
            self._path_changed = False
            poses = self._path.poses()
            stamps_ns = [of(t_s) for t_s in poses[:, 0].tolist()]
            yield ros_messages.of_path(round(wall_s * NS), stamps_ns, poses[:, 1:].tolist())
        if self._doors_changed and self._doors_pace.due(now_s):
            self._doors_changed = False
            yield ros_messages.of_doors(round(wall_s * NS), list(self._doors.values()))

    def _map(self, grid: GridUpdate) -> Iterator[Sent]:
        try:
            cells = cells_of(grid)
        except ValueError as error:
            self._undecodable.count(GRID.key, str(error))
            return
        yield ros_messages.of_map(self._time.of(grid.t_s), cells, (grid.origin_x_m, grid.origin_y_m), grid.cell_m)

    def _keep(self, poi: PointOfInterest) -> None:
        self._doors.pop(poi.poi_id, None)
        self._doors[poi.poi_id] = poi
        self._doors_changed = True
        if len(self._doors) > DOORS_MAX:
            del self._doors[next(iter(self._doors))]

    def _order(self, wish: Goal | InitialPose) -> None:
        refusal = self._refusal(wish)
        if refusal or self._operator is None:
            _log.warning("a %s was refused: %s", "goal" if isinstance(wish, Goal) else "pose", refusal)
        elif isinstance(wish, Goal):
            self._operator.operate(Order(Operation.GOTO, wish.x_m, wish.y_m))
        else:
            heading_rad, sd_m, sd_heading_rad = wish.heading_rad, wish.sd_m, wish.sd_heading_rad
            order = Order(
                Operation.POSE, wish.x_m, wish.y_m, heading_rad=heading_rad, sd_m=sd_m, sd_heading_rad=sd_heading_rad
            )
            self._operator.operate(order)

    def _refusal(self, wish: Goal | InitialPose) -> str:
        """Why it is no order, as words; empty where it is one."""
        if self._operator is None:
            return "programs of other machines can publish here too, so nobody may order anything"
        if wish.frame.removeprefix("/") != MAP_FRAME:
            return f"its frame is {plain(wish.frame, _FRAME_MAX) or '(none)'}, not {MAP_FRAME}"
        if not all(isfinite(m) and COORDINATE.low <= m <= COORDINATE.high for m in (wish.x_m, wish.y_m)):
            return "no place of a floor"
        if isinstance(wish, InitialPose) and not all(map(isfinite, (wish.heading_rad, wish.sd_m, wish.sd_heading_rad))):
            return "no heading, or no covariance"
        return self._view.hindrance

    def _detail(self) -> str:
        if self._operator is None:
            return "no orders from here"
        return self._view.hindrance or self._view.answer or "goals and poses of this machine are taken"
