"""The robot's own processes around the simulated body with its real firmware, and a command center that looks on."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from common.messages import STATUS, Operation, Permit
from deploy.local.process_table import PROCESSES
from offboard.command_center.operations import Answer
from offboard.command_center.software_stop import Demand, Look
from offboard.simulator.run.options import FLOORS
from offboard.simulator.run.process import MOTORS_NAME
from tests.system.center import Center
from tests.system.conftest import Mesh, until
from tests.system.motors import MotorLog


class Robot(Mesh):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.motors = MotorLog(folder / MOTORS_NAME)
        for name in ("comm", "mmu"):
            self.run(name)
        self.start("simulator", "-m", PROCESSES["simulator"], extra=("--floor", str(FLOORS / "loop.json")))
        until((folder / "serial").exists, 30.0, "the serial port")
        self.run("bridge")
        self.center = Center(self.config)
        self.bus.latest(STATUS["comm"])
        self.bus.latest(STATUS["bridge"])

    def run(self, name: str) -> None:
        self.start(name, "-m", PROCESSES[name])

    def kill(self, *names: str) -> float:
        """All at once; returns when."""
        killed_s = time.monotonic()
        for name in names:
            self.signal(name, signal.SIGKILL)
        for name in names:
            self.processes[name].communicate()  # waits, and closes its stderr
        return killed_s

    def push_button(self) -> float:
        """In, or out again; returns when."""
        return self.signal("simulator", signal.SIGUSR1)

    def reset_board(self) -> None:
        self.signal("simulator", signal.SIGUSR2)

    @property
    def permit(self) -> Permit:
        return self.permits[-1][1]

    def await_sound(self, since_s: float) -> None:
        """Until nothing is missing again of what was hit at `since_s`."""

        def sound() -> bool:
            status = self.bus.latest(STATUS["comm"])
            return status is not None and status.t_s > since_s + 1.0 and not status.detail

        until(sound, 40.0, "a robot that is whole again")

    def drive(self) -> None:
        """Until it drives, whatever was before."""
        if "planner" not in self.processes or self.processes["planner"].poll() is not None:
            self.run("planner")
        if self.center.node.snapshot().report.button_pressed:
            self.push_button()

        def driving() -> bool:
            snapshot = self.center.node.snapshot()
            if snapshot.operation is None or snapshot.operation.answer is not Answer.WAITING:
                if snapshot.look is Look.LATCHED:
                    self.center.node.stop_desk.release()
                self.center.node.operate(Operation.RESUME if snapshot.look is Look.RELEASED else Operation.START)
            return self.motors.read()[-1].driving

        until(driving, 60.0, "driving")

    def press(self) -> None:
        """Until it is confirmed."""
        desk = self.center.node.stop_desk
        desk.press()
        until(lambda: desk.control.latency_s is not None, what="the confirmation of the stop")

    def release(self) -> None:
        desk = self.center.node.stop_desk
        until(lambda: not desk.hindrance(), what="a stop that may be released")
        desk.release()
        until(lambda: desk.control.demand is Demand.NONE and not self.permit.stop_sources, what="the release")

    def operate(self, operation: Operation) -> None:
        """Until it is taken."""
        assert self.answer_to(operation) is Answer.TAKEN

    def answer_to(self, operation: Operation) -> Answer:
        """What came back, or that nothing did."""
        earlier = self._serial
        self.center.node.operate(operation)
        until(lambda: self._serial > earlier and self._answer is not Answer.WAITING, what=f"the answer to {operation}")
        return self._answer

    @property
    def _serial(self) -> int:
        result = self.center.node.snapshot().operation
        return 0 if result is None else result.serial

    @property
    def _answer(self) -> Answer:
        result = self.center.node.snapshot().operation
        return Answer.WAITING if result is None else result.answer

    def go_on(self) -> None:
        """A robot that stands, by a release, which moves nothing, and a resume, which does."""
        stood_s = time.monotonic()
        self.release()
        resumed_s = time.monotonic()
        assert not self.motors.turned(stood_s, resumed_s)
        self.operate(Operation.RESUME)
        self.motors.await_driving(resumed_s)

    def close(self) -> None:
        self.center.close()
        super().close()
