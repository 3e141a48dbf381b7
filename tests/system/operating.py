"""Who sits at a command center: presses and releases, starts and resumes, each until the robot has answered."""

from __future__ import annotations

import time

from common.messages.mission import Operation
from offboard.operate.operations import Answer
from offboard.operate.software_stop import Demand, Look
from tests.system.center import Center
from tests.system.conftest import until
from tests.system.motors import MotorLog


class Operator:
    """With a command center, and an eye on the motors."""

    center: Center
    motors: MotorLog

    def drive(self, deadline_s: float = 60.0) -> None:
        """Until it drives, whatever was before."""

        def driving() -> bool:
            self.ask_for_motion()
            return self.motors.read()[-1].driving

        until(driving, deadline_s, "driving")

    def ask_for_motion(self) -> None:
        """Sends what the robot's state demands, unless an answer is still awaited."""
        snapshot = self.center.node.snapshot()
        if snapshot.operation is None or snapshot.operation.answer is not Answer.WAITING:
            if snapshot.look is Look.LATCHED:
                self.center.node.stop_desk.release()
            self.center.node.operate(Operation.RESUME if snapshot.look is Look.RELEASED else Operation.START)

    def press(self) -> None:
        """Until it is confirmed."""
        desk = self.center.node.stop_desk
        desk.press()
        until(lambda: desk.control.latency_s is not None, what="the confirmation of the stop")

    def release(self) -> None:
        desk = self.center.node.stop_desk
        until(lambda: not desk.hindrance(), what="a stop that may be released")
        desk.release()
        until(lambda: desk.control.demand is Demand.NONE and not self._stopped, what="the release")

    def operate(self, operation: Operation) -> None:
        """Until it is taken."""
        assert self.answer_to(operation) is Answer.TAKEN

    def answer_to(self, operation: Operation) -> Answer:
        """What came back, or that nothing did."""
        earlier = self._serial
        self.center.node.operate(operation)
        until(lambda: self._serial > earlier and self._answer is not Answer.WAITING, what=f"the answer to {operation}")
        return self._answer

    def go_on(self) -> None:
        """A robot that stands, by a release, which moves nothing, and a resume, which does."""
        stood_s = time.monotonic()
        self.release()
        resumed_s = time.monotonic()
        assert not self.motors.turned(stood_s, resumed_s)
        self.operate(Operation.RESUME)
        self.motors.await_driving(resumed_s)

    @property
    def _stopped(self) -> bool:
        permit = self.center.node.snapshot().permit
        return permit is None or bool(permit.stop_sources)

    @property
    def _serial(self) -> int:
        result = self.center.node.snapshot().operation
        return 0 if result is None else result.serial

    @property
    def _answer(self) -> Answer:
        result = self.center.node.snapshot().operation
        return Answer.WAITING if result is None else result.answer
