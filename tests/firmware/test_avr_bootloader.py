"""The binary behind the bootloader that every Mega is sold with, under the real bridge.

That bootloader starts the sketch only when nobody talks to it: a bridge that went on with its heartbeats through a
restart would keep the robot from ever coming up.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from common.bus import LocalMesh
from common.constants import TICK_M
from common.messages.motion import CarrierReport, CarrierState, DriveCommand, Speed
from common.messages.stop import Permit
from common.messages.topics import CARRIER, DRIVE, PERMIT
from offboard.simulator.electronics.avr_board import AvrBoard
from offboard.simulator.electronics.board import ResetCause
from onboard.bridge.bridge import Bridge
from onboard.bridge.line_protocol import encode
from onboard.bridge.protocol import Hb

STEP_US = 5000


class Direct:
    """The board's UART as the bridge's port."""

    def __init__(self, board: AvrBoard) -> None:
        self._board = board

    def read(self) -> bytes:
        return self._board.serial_read()

    def write(self, data: bytes) -> None:
        self._board.serial_write(data)


class Robot:
    """Bridge and board; the wheels turn as the motors are told, without a body."""

    def __init__(self, board: AvrBoard) -> None:
        self.board = board
        self.now_us = self.power_on_us = 0
        mesh = self.mesh = LocalMesh()
        self.bus, self.person = mesh.endpoint("bridge"), mesh.endpoint("person")
        self.bridge = Bridge(lambda: Direct(board))
        self.rolled = [0.0, 0.0]
        self.ticks = [0, 0]

    def step(self) -> None:
        self.now_us += STEP_US
        now_s = self.mesh.now_s = self.now_us / 1e6
        *pwm, enabled = self.board.outputs()
        for wheel in (0, 1):
            self.rolled[wheel] += 0.0014 * pwm[wheel] * STEP_US / 1e6 / TICK_M if enabled else 0.0
        ticks = [int(rolled // 1) for rolled in self.rolled]
        self.board.encoder_edges(ticks[0] - self.ticks[0], ticks[1] - self.ticks[1])
        self.ticks = ticks
        self.board.imu(0, 0, 16384, 0, 0, 30)
        for sonar in self.board.fired():
            self.board.echo(sonar, 37500)
        self.board.run(self.now_us - self.power_on_us)
        if self.now_us % 10_000 == 0:
            if self.now_us % 100_000 == 0:
                self.person.publish(PERMIT, Permit(now_s, True, ""))
            self.bridge.step(self.bus, now_s)

    def until(self, holds: Callable[[], bool], within_s: float) -> float:
        start_us = self.now_us
        while not holds():
            assert self.now_us - start_us < within_s * 1e6, self.report()
            self.step()
        return (self.now_us - start_us) / 1e6

    def report(self) -> CarrierReport | None:
        return self.person.latest(CARRIER)

    def fresh_ready(self) -> Callable[[], bool]:
        """Has the board said since now that it is armed?"""
        since_s = self.now_us / 1e6

        def holds() -> bool:
            report = self.report()
            return report is not None and report.t_s > since_s + 0.1 and report.state is CarrierState.READY

        return holds

    def drive(self, command_id: int) -> None:
        self.person.publish(DRIVE, DriveCommand(self.now_us / 1e6, command_id, Speed.MEDIUM, 0.0))

    def moves(self) -> bool:
        return self.board.outputs()[0] > 0

    def reset(self, cause: ResetCause) -> None:
        self.board.reset(cause)
        self.power_on_us = self.now_us


@pytest.fixture
def robot(bootloader: Path) -> Robot:
    return Robot(AvrBoard(bootloader=bootloader))


def test_the_bridge_brings_the_board_up_from_power_on(robot: Robot) -> None:
    assert robot.until(robot.fresh_ready(), 10.0) < 6.0
    robot.drive(1)
    robot.until(robot.moves, 1.0)


@pytest.mark.parametrize("cause", [ResetCause.EXTERNAL, ResetCause.POWER_ON, ResetCause.WATCHDOG])
def test_the_bridge_brings_the_board_up_again_after_a_reset_in_the_middle_of_talking(
    robot: Robot, cause: ResetCause
) -> None:
    robot.until(robot.fresh_ready(), 10.0)
    robot.drive(1)
    robot.until(robot.moves, 1.0)
    robot.reset(cause)
    robot.step()
    assert robot.board.outputs() == (0, 0, False)
    ready = robot.fresh_ready()

    def up_and_never_moving_by_itself() -> bool:
        assert not robot.moves()
        return ready()

    assert robot.until(up_and_never_moving_by_itself, 20.0) < 15.0
    robot.drive(2)
    robot.until(robot.moves, 1.0)


def test_a_bootloader_that_hears_heartbeats_never_starts_the_sketch(bootloader: Path) -> None:
    """The reason for the bridge's silence; it fails once that has gone, and the rule with it."""
    board = AvrBoard(bootloader=bootloader)
    for n in range(1, 1600):
        if n % 20 == 0:
            board.serial_write(encode(Hb(n, 1), n))
        board.run(n * STEP_US)
        assert b"HELLO" not in board.serial_read()
