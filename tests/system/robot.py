"""The robot's own processes around the simulated body with its real firmware, and a command center that looks on."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from common.messages.stop import Permit
from common.messages.topics import STATUS
from deploy.local.process_table import PROCESSES
from offboard.simulator.run.options import FLOORS
from offboard.simulator.run.process import MOTORS_NAME
from tests.system.center import Center
from tests.system.conftest import Mesh, until
from tests.system.motors import MotorLog
from tests.system.operating import Operator


class Robot(Operator, Mesh):
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

    def drive(self, deadline_s: float = 60.0) -> None:
        if "planner" not in self.processes or self.processes["planner"].poll() is not None:
            self.run("planner")
        if self.center.node.snapshot().report.button_pressed:
            self.push_button()
        super().drive(deadline_s)

    def close(self) -> None:
        self.center.close()
        super().close()
