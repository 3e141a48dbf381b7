"""A robot under way on a small floor, and what a person at the laptop does and sees."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from typing import Any

from common.messages.mission import Operation, OperatorCommand
from common.messages.motion import CarrierReport
from common.messages.topics import CARRIER, OPERATION, PERMIT
from offboard.simulator.run.lockstep import Lockstep


class Story:
    """Every wait is in simulated time."""

    def __init__(self, robot: Lockstep) -> None:
        self.robot = robot
        self.world = robot.simulation.world

    @property
    def now_s(self) -> float:
        return self.robot.now_s

    def say(self, operation: Operation) -> None:
        permit = self.robot.operator.latest(PERMIT)
        epoch = permit.stop_epoch if permit is not None else 0
        self.robot.operator.publish(OPERATION, OperatorCommand(self.now_s, operation, epoch=epoch))

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
