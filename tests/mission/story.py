"""A robot under way on a small floor, and what a person at the laptop does and sees."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from typing import Any

from common.messages.mission import Operation, OperatorCommand, PlannerView
from common.messages.motion import CarrierReport
from common.messages.topics import CARRIER, OPERATION, PERMIT, PLAN
from offboard.simulator.run.lockstep import Lockstep


class Story:
    """Every wait is in simulated time."""

    def __init__(self, robot: Lockstep) -> None:
        self.robot = robot
        self.world = robot.simulation.world

    @property
    def now_s(self) -> float:
        return self.robot.now_s

    def say(self, operation: Operation, x_m: float = 0.0, y_m: float = 0.0) -> None:
        permit = self.robot.operator.latest(PERMIT)
        epoch = permit.stop_epoch if permit is not None else 0
        self.robot.operator.publish(OPERATION, OperatorCommand(self.now_s, operation, x_m, y_m, epoch=epoch))

    def draw(self, kind: Operation, *corners_m: tuple[float, float]) -> None:
        """A line or area, on the map."""
        xs, ys = tuple(x_m for x_m, _ in corners_m), tuple(y_m for _, y_m in corners_m)
        command = OperatorCommand(self.now_s, kind, corners_x_m=xs, corners_y_m=ys)
        self.robot.operator.publish(OPERATION, command)

    def view(self) -> PlannerView:
        view = self.robot.operator.latest(PLAN)
        assert view is not None
        return view

    def ended(self) -> bool:
        view = self.robot.operator.latest(PLAN)
        return view is not None and view.outcome.ends_mission

    def start(self) -> None:
        """Wait until it may move, and ask it to."""
        assert self.until(self.granted, 60.0), "the modules must become ready"
        self.say(Operation.START)

    def granted(self) -> bool:
        permit = self.robot.operator.latest(PERMIT)
        return permit is not None and permit.granted

    def carrier(self) -> CarrierReport:
        report = self.robot.operator.latest(CARRIER)
        assert report is not None
        return report

    def drives(self) -> bool:
        return self.carrier().speed_m_s > 0.1

    def wheels_stand(self) -> bool:
        return self.world.board.outputs()[:2] == (0, 0)

    def until(self, condition: Callable[[], bool], within_s: float) -> bool:
        return self.robot.run_until(condition, self.now_s + within_s)

    def run(self, seconds: float, watch: Callable[[], Any] = lambda: None) -> None:
        """Go on, looking at every step."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.robot.advance()
            watch()

    def goes_on(self, step_m: float = 0.5, within_s: float = 90.0) -> bool:
        """Does it get that far away from where it is?"""
        from_pose = self.world.truth
        return self.until(
            lambda: hypot(self.world.truth.x_m - from_pose.x_m, self.world.truth.y_m - from_pose.y_m) > step_m, within_s
        )
