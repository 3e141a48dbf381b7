"""A `BoardLink` on a clock, with the moves that checks and calibration are made of. Port -> moves, waits, records."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

from common.errors import StartError
from common.messages.motion import Speed
from deploy.boards.board_link import BoardLink
from onboard.bridge.protocol import Message, Odo, OdoFlag, SimState
from onboard.bridge.serial_port import Port

STEP_S = 0.02
CONNECT_S = 15.0  # a bootloader that was disturbed takes several seconds
TURN_S = 30.0


class BoardSession:
    """`now` and `sleep` are the clock; `sleep` may also be what moves a simulated world on."""

    def __init__(self, port: Port, now: Callable[[], float], sleep: Callable[[float], None]) -> None:
        self.link = BoardLink(port)
        self._now, self._sleep = now, sleep
        self.counts: list[tuple[int, int]] = []  # every report's ticks since `record`

    def step(self) -> list[Message]:
        messages = self.link.step(self._now())
        self.counts += [(m.ticks_left, m.ticks_right) for m in messages if isinstance(m, Odo)]
        self._sleep(STEP_S)
        return messages

    def run(self, seconds: float) -> None:
        end_s = self._now() + seconds
        while self._now() < end_s:
            self.step()

    def until(self, holds: Callable[[], bool], within_s: float, otherwise: str) -> None:
        """Raises StartError with that sentence when it does not come to hold."""
        end_s = self._now() + within_s
        while not holds():
            if self._now() > end_s:
                self.link.stop()
                raise StartError(otherwise)
            self.step()

    def connect(self) -> None:
        """Until HELLO of the board has come and its gyro is calibrated."""
        self.until(
            lambda: self.link.connected,
            CONNECT_S,
            "The board sends no HELLO: is the firmware flashed, and no other program on the port?",
        )
        self.until(
            lambda: self.link.sim is not None and self.link.sim.state == SimState.RUNNING,
            10.0,
            "The gyro is not ready: leave the robot standing still, and check the IMU's wires (SDA D20, SCL D21).",
        )

    def arm(self) -> None:
        self.link.allow_motion()
        self.until(
            lambda: self.link.ready,
            3.0,
            "The board does not let itself be armed: is the stop button pressed, or the bumper's wire open?",
        )

    def record(self) -> None:
        """Begins the record of counts anew."""
        self.counts = [] if self.link.odo is None else [(self.link.odo.ticks_left, self.link.odo.ticks_right)]

    def turn_to(self, yaw_deg: float) -> None:
        command = self.link.drive(Speed.STOP, yaw_deg)
        self._finish(command, "The robot did not come round: are its wheels free, motors and encoders not swapped?")

    def straight(self, length_m: float, yaw_deg: float) -> None:
        """So far by its own reckoning, then it stands."""
        start = self._place_m()
        command = self.link.drive(Speed.MEDIUM, yaw_deg)
        self.until(
            lambda: (
                self.link.aborted(command)
                or hypot(*(a - b for a, b in zip(self._place_m(), start, strict=True))) >= length_m
            ),
            10.0 + 2.0 * length_m / 0.16,
            "The robot does not get on: are its wheels free?",
        )
        if self.link.aborted(command):
            self.link.stop()
            raise StartError("Bumper, cliff sensor or sonars report an obstacle: clear it, then repeat.")
        self.turn_to(yaw_deg)
        self.until(self._stands, 5.0, "The robot does not come to rest.")

    def _finish(self, command: int, otherwise: str) -> None:
        self.until(lambda: self.link.completed(command) or self.link.aborted(command), TURN_S, otherwise)
        if not self.link.completed(command):
            self.link.stop()
            raise StartError(otherwise)

    def _place_m(self) -> tuple[float, float]:
        odo = self.link.odo
        if odo is None:
            raise StartError("The board fell silent: check cable and battery.")
        return odo.x_mm / 1000.0, odo.y_mm / 1000.0

    def _stands(self) -> bool:
        return self.link.odo is not None and bool(self.link.odo.flags & OdoFlag.STANDING)
