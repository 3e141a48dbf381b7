"""What stops the robot, at the firmware: heartbeats, stop byte, button, garbage (CAR_MR_05)."""

from __future__ import annotations

import random

import pytest

from offboard.simulator.electronics.board import HostBoard, ResetCause
from onboard.bridge.line_protocol import encode
from onboard.bridge.protocol import (
    HASH,
    STOP_BYTE,
    Ack,
    CarState,
    Drv,
    Hb,
    Hello,
    Rel,
    SimSta,
    Start,
    Stop,
    StopSourceFlag,
)
from tests.firmware.bench import Bench, ready_bench

MEDIUM = 1


def driving_bench() -> Bench:
    bench = ready_bench()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(2.0)
    assert bench.speed_m_s > 0.15
    return bench


def test_robot_stops_when_heartbeats_stop() -> None:
    bench = driving_bench()
    bench.run_until(lambda: bench.now_us % 100_000 == 5000)
    bench.heartbeats = False
    took_s = bench.run_until(lambda: not bench.enabled, 1.0)
    assert 0.25 < took_s <= 0.4
    bench.run(0.2)
    assert bench.car.state == CarState.READY
    assert bench.car.error == 201
    assert bench.car.aborted_id == 1
    bench.run_until(lambda: bench.car.state == CarState.DISARMED, 1.0)


def test_heartbeats_that_come_back_do_not_move_the_robot() -> None:
    bench = driving_bench()
    bench.heartbeats = False
    bench.run_until(lambda: not bench.enabled, 1.0)
    bench.heartbeats = True
    bench.run(1.0)
    assert bench.pwm == (0, 0)
    assert abs(bench.speed_m_s) < 0.001
    bench.drive(1, MEDIUM, 0.0)
    bench.run(0.5)
    assert bench.pwm == (0, 0)
    bench.drive(2, MEDIUM, 0.0)
    bench.run(2.0)
    assert bench.speed_m_s > 0.15


@pytest.mark.requirement("CAR_MR_05")
@pytest.mark.parametrize("how", ["byte", "frame", "button"])
def test_stop_takes_the_power_at_once_and_latches(how: str) -> None:
    bench = driving_bench()
    if how == "byte":
        bench.board.serial_write(b"CM_CAR_12" + STOP_BYTE)
    elif how == "frame":
        bench.send(Stop(1))
    else:
        bench.board.stop_button(True)
    took_s = bench.run_until(lambda: not bench.enabled, 0.1)
    assert took_s <= 0.015
    bench.board.stop_button(False)
    bench.run(1.0)
    assert bench.car.stop_latched == (2 if how == "button" else 1)
    assert bench.car.state == CarState.STOPPED
    bench.drive(2, MEDIUM, 0.0)
    bench.send(Start(HASH, 1))
    bench.run(0.5)
    assert bench.pwm == (0, 0)
    assert not bench.enabled


def test_release_moves_nothing_until_a_new_command() -> None:
    bench = driving_bench()
    bench.board.serial_write(STOP_BYTE)
    bench.run(0.5)
    bench.send(Rel(1))
    bench.run(0.5)
    assert not bench.enabled
    assert bench.car.state == CarState.DISARMED
    bench.send(Start(HASH, 1))
    bench.drive(1, MEDIUM, 0.0)
    bench.run(1.0)
    assert bench.car.state == CarState.READY
    assert bench.pwm == (0, 0)
    bench.drive(2, MEDIUM, 0.0)
    bench.run(2.0)
    assert bench.speed_m_s > 0.15


def stopped_after_restart(bench: Bench) -> bool:
    bench.board.reset()
    bench.now_us, bench.car = 0, None
    bench.run_until(lambda: bench.car is not None, 1.0)
    return bool(bench.car.stop_latched & StopSourceFlag.BUTTON)


@pytest.mark.requirement("CAR_MR_05")
@pytest.mark.parametrize("kind", ["host", "avr"])
def test_a_stop_by_the_button_outlives_a_restart_until_it_is_released(
    kind: str, request: pytest.FixtureRequest
) -> None:
    bench = Bench(request.getfixturevalue("avr") if kind == "avr" else HostBoard())
    bench.run(0.2)
    bench.board.stop_button(True)
    bench.run(0.2)
    bench.board.stop_button(False)
    assert stopped_after_restart(bench)
    bench.send(Rel(1))
    bench.run(0.2)
    assert not stopped_after_restart(bench)


def test_release_is_refused_while_the_button_is_pressed() -> None:
    bench = driving_bench()
    bench.board.stop_button(True)
    bench.run(0.2)
    bench.send(Rel(1))
    bench.run(0.2)
    assert [m.result for m in bench.received if isinstance(m, Ack) and m.of == 5][-1] == 1
    assert bench.car.stop_latched == 2


def test_start_of_another_protocol_is_refused() -> None:
    bench = Bench()
    bench.heartbeats = True
    bench.run(3.0)
    bench.send(Start(HASH ^ 1, 1))
    bench.run(0.3)
    assert bench.car.state == CarState.DISARMED
    assert not bench.enabled


def test_board_says_hello_at_once_and_every_second_until_armed() -> None:
    bench = Bench()
    bench.run(5.0)
    hellos = [m for m in bench.received if isinstance(m, Hello)]
    assert len(hellos) == 5
    bench.arm()
    count = len([m for m in bench.received if isinstance(m, Hello)])
    bench.run(3.0)
    assert len([m for m in bench.received if isinstance(m, Hello)]) == count


def test_session_changes_with_a_restart_and_a_watchdog_reset_is_told() -> None:
    bench = Bench()
    bench.run(0.5)
    first = next(m for m in bench.received if isinstance(m, Hello))
    bench.board.reset(ResetCause.WATCHDOG)
    bench.received.clear()
    bench.now_us = 0
    bench.run(0.5)
    second = next(m for m in bench.received if isinstance(m, Hello))
    assert second.session != first.session
    assert second.reset_cause == ResetCause.WATCHDOG
    assert bench.car.error == 206


def test_nothing_moves_before_the_gyro_is_calibrated() -> None:
    bench = Bench()
    bench.heartbeats = True
    bench.run(0.5)
    bench.send(Start(HASH, 1))
    bench.drive(1, MEDIUM, 0.0)
    bench.run(0.5)
    assert bench.car.state == CarState.BOOT
    assert bench.pwm == (0, 0)


def test_silent_imu_is_a_fault_that_stops() -> None:
    class Unpluggable(HostBoard):
        unplugged = False

        def imu(self, ax: int, ay: int, az: int, gx: int, gy: int, gz: int) -> None:
            if not self.unplugged:
                super().imu(ax, ay, az, gx, gy, gz)

    board = Unpluggable()
    bench = Bench(board)
    bench.arm()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(1.0)
    board.unplugged = True
    board.imu_unplug()
    bench.run_until(lambda: not bench.enabled, 0.1)
    bench.run(0.2)
    assert bench.car.state == CarState.FAULT
    assert [m.error for m in bench.received if isinstance(m, SimSta)][-1] == 102


def test_random_bytes_start_no_motor() -> None:
    chance = random.Random(1)
    bench = ready_bench()
    alphabet = bytes(range(256)) + b"CMPLNCARDRVHBSTART_,*0123456789\n" * 8
    for _ in range(400):
        bench.board.serial_write(bytes(b for b in chance.choices(alphabet, k=200) if b != STOP_BYTE[0]))
        bench.step()
        assert bench.pwm == (0, 0)


@pytest.mark.parametrize("message", [Drv(1, 3, 1, 9000), Start(HASH, 1), Hb(7, 1), Rel(1)])
def test_every_single_bit_error_in_a_line_is_rejected(message) -> None:
    """By the firmware: a damaged line is neither acknowledged nor obeyed."""
    line = encode(message, 123456)
    board = HostBoard()
    bench = Bench(board)
    bench.run(2.5)
    for bit in range(8 * len(line)):
        damaged = bytearray(line)
        damaged[bit // 8] ^= 1 << bit % 8
        board.serial_write(bytes(damaged) + b"\n")
        bench.step()
        assert not bench.enabled
    bench.run(0.3)
    accepted = [m for m in bench.received if isinstance(m, Ack) and m.of != 4]
    assert accepted == []


def test_a_line_after_garbage_is_understood() -> None:
    bench = ready_bench()
    bench.board.serial_write(b"x" * 300 + b"\n" + encode(Drv(1, 9, 1, 0), 5))
    bench.run(0.2)
    assert bench.car.command_id == 9


def test_reports_keep_below_sixty_percent_of_the_line() -> None:
    board = HostBoard()
    bench = Bench(board)
    total = 0
    original = board.serial_read

    def counting() -> bytes:
        nonlocal total
        data = original()
        total += len(data)
        return data

    board.serial_read = counting  # type: ignore[method-assign]
    bench.arm()
    total = 0
    for n in range(50):
        bench.drive(1 + n, MEDIUM, n % 9)
        bench.run(0.1)
    assert total / 5.0 < 0.6 * 11520
