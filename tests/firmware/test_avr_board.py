"""The binary for the Mega in simavr: its drivers, and how fast what must stop stops (SIM_MR_02..05, CAR_MR_05)."""

from __future__ import annotations

import pytest

from common.constants import ENCODER_TICKS_PER_TURN, SERIAL_BAUD, WHEEL_DIAMETER_M
from offboard.simulator.electronics.avr_board import AvrBoard, build_avr_firmware
from onboard.bridge.line_protocol import LineDecoder
from onboard.bridge.protocol import STOP_BYTE, CarSta, CarState, Hello, OdoFlag, ResetCause, Rng, SimSta
from tests.firmware.bench import STEP_US, Bench

MEDIUM, HIGH = 1, 2
FINE_US = 100


def driving(board: AvrBoard, speed: int = MEDIUM) -> Bench:
    bench = Bench(board)
    bench.arm()
    bench.drive(1, speed, 0.0)
    bench.run(2.0)
    assert bench.pwm[0] > 0
    assert bench.pwm[1] > 0
    return bench


def off(board: AvrBoard) -> bool:
    return board.outputs() == (0, 0, False)


def time_to_off_us(bench: Bench, limit_us: int) -> int:
    """In steps of 0.1 ms, the body aside: what matters are the pins."""
    start_us = bench.now_us
    while not off(bench.board):
        assert bench.now_us - start_us <= limit_us
        bench.now_us += FINE_US
        bench.board.run(bench.now_us)
    return bench.now_us - start_us


@pytest.mark.requirement("CAR_MR_05")
@pytest.mark.parametrize("before", [b"", b"CM_CAR_12_HB,1", b"x" * 300], ids=["alone", "in a line", "behind garbage"])
def test_stop_byte_turns_the_motors_off_within_two_milliseconds(avr: AvrBoard, before: bytes) -> None:
    bench = driving(avr, HIGH)
    avr.serial_write(before)
    for _ in range(400):  # until the wire is empty
        bench.now_us += FINE_US
        avr.run(bench.now_us)
    assert not off(avr)
    avr.serial_write(STOP_BYTE)
    assert time_to_off_us(bench, 20_000) <= 2_000
    bench.now_us += -bench.now_us % STEP_US
    bench.run(0.5)
    assert off(avr)
    assert bench.car.state == CarState.STOPPED


def test_stop_byte_works_while_the_loop_hangs(avr_tools: None) -> None:
    """It is the receive interrupt that acts, not the decoder behind it."""
    board = AvrBoard(elf=build_avr_firmware("endless_loop_1", "-DPLANT_ENDLESS_LOOP=1"))
    bench = Bench(board)
    bench.arm()
    bench.drive(1, MEDIUM, 0.0)
    bench.run_until(lambda: bench.pwm[0] > 0, 1.0)
    board.serial_write(STOP_BYTE)
    assert time_to_off_us(bench, 20_000) <= 2_000


def test_motors_are_off_soon_after_the_heartbeats_stop(avr: AvrBoard) -> None:
    bench = driving(avr, HIGH)
    bench.run_until(lambda: bench.now_us % 100_000 == STEP_US)
    bench.heartbeats = False
    took_s = bench.run_until(lambda: off(avr), 1.0)
    assert 0.25 < took_s <= 0.45


@pytest.mark.parametrize("interrupts", ["on", "off"])
def test_an_endless_loop_ends_in_a_restart_with_the_motors_off(avr_tools: None, interrupts: str) -> None:
    kind = 1 if interrupts == "on" else 2
    board = AvrBoard(elf=build_avr_firmware(f"endless_loop_{kind}", f"-DPLANT_ENDLESS_LOOP={kind}"))
    bench = Bench(board)
    bench.arm()
    bench.drive(1, MEDIUM, 0.0)
    bench.run_until(lambda: bench.pwm[0] > 0, 1.0)
    hung_us = bench.now_us
    bench.run_until(lambda: board.watchdog_resets == 1, 1.0)
    assert bench.now_us - hung_us <= 300_000
    assert off(board)
    bench.received.clear()
    bench.run(0.5)
    assert off(board)
    hello = next(m for m in bench.received if isinstance(m, Hello))
    assert hello.reset_cause == ResetCause.WATCHDOG
    assert bench.car.error == 206


def test_motors_are_off_before_the_restart_of_a_loop_that_hangs(avr_tools: None) -> None:
    board = AvrBoard(elf=build_avr_firmware("endless_loop_1", "-DPLANT_ENDLESS_LOOP=1"))
    bench = Bench(board)
    bench.arm()
    bench.drive(1, MEDIUM, 0.0)
    bench.run_until(lambda: bench.pwm[0] > 0, 1.0)
    assert time_to_off_us(bench, 100_000) <= 70_000
    assert board.watchdog_resets == 0


@pytest.mark.requirement("SIM_MR_02")
def test_every_edge_counts_up_to_twice_the_highest_speed(avr: AvrBoard) -> None:
    bench = Bench(avr)
    bench.run(1.0)
    per_step = round(2 * 0.30 / (3.14159 * WHEEL_DIAMETER_M) * ENCODER_TICKS_PER_TURN * STEP_US / 1e6)
    for n in range(400):
        avr.encoder_edges(per_step, -per_step if n < 200 else per_step)
        bench.step()
    bench.run(0.2)
    assert bench.odo.ticks_left == 400 * per_step
    assert bench.odo.ticks_right == 0


@pytest.mark.requirement("SIM_MR_01")
@pytest.mark.parametrize("inches", [6, 57, 254])
def test_pulse_width_is_timed_to_a_millimetre(avr: AvrBoard, inches: int) -> None:
    bench = Bench(avr)
    bench.echo_us = [inches * 147] * 5
    bench.run(1.0)
    ranges = [m for m in bench.received if isinstance(m, Rng)][-1]
    assert all(mm == pytest.approx(inches * 25.4, abs=1.0) for mm in ranges.range_mm)
    assert all(age <= 250 for age in ranges.age_ms)


def test_imu_that_lost_its_power_for_a_moment_is_set_up_anew(avr: AvrBoard) -> None:
    bench = Bench(avr)
    bench.run(2.5)
    assert bench.odo.flags & OdoFlag.CALIBRATED

    avr.imu_unplug()
    for _ in range(40):
        bench.now_us += STEP_US
        avr.run(bench.now_us)
    bench.run(0.5)  # the bench plugs it in again: asleep, as after power-on
    bench.received.clear()
    bench.run(0.5)
    assert [m.error for m in bench.received if isinstance(m, SimSta)][-1] == 0
    assert bench.odo.rate_cdps == pytest.approx(0, abs=20)


def test_a_hanging_imu_bus_is_freed_before_anybody_notices(avr: AvrBoard) -> None:
    bench = Bench(avr)
    bench.run(2.5)
    bench.received.clear()
    for _ in range(5):
        avr.imu_hang()
        bench.run(0.3)
    assert {m.error for m in bench.received if isinstance(m, SimSta)} == {0}
    assert bench.odo.flags & OdoFlag.CALIBRATED


def test_an_imu_that_never_answers_is_a_fault(avr: AvrBoard) -> None:
    avr.imu_unplug()
    for n in range(1, 100):
        avr.run(n * STEP_US)
    said = [r.message for r in LineDecoder().feed(avr.serial_read())]
    assert [m.error for m in said if isinstance(m, SimSta)][-1] == 102
    assert [m.state for m in said if isinstance(m, CarSta)][-1] == CarState.FAULT


def test_battery_and_switches_reach_the_reports(avr: AvrBoard) -> None:
    bench = Bench(avr)
    avr.battery(11_100)
    bench.run(0.5)
    assert bench.car.battery_mv == pytest.approx(11_100, abs=30)
    avr.battery(9_900)
    avr.bumper(True)
    avr.cliff(False, True)
    bench.run(0.3)
    assert [m.error for m in bench.received if isinstance(m, SimSta)][-1] == 104
    assert bench.odo.flags & OdoFlag.BUMPER
    assert bench.odo.flags & OdoFlag.CLIFF_RIGHT
    assert not bench.odo.flags & OdoFlag.CLIFF_LEFT
    avr.stop_button(True)
    bench.run(0.2)
    assert bench.car.state in (CarState.BOOT, CarState.STOPPED)
    assert bench.car.stop_latched == 2


@pytest.mark.parametrize(
    ("how", "cause"),
    [("power", ResetCause.POWER_ON), ("button", ResetCause.EXTERNAL), ("brown-out", ResetCause.BROWN_OUT)],
)
def test_hello_says_why_the_board_began(avr: AvrBoard, how: str, cause: ResetCause) -> None:
    bench = Bench(avr)
    bench.run(0.3)
    first = next(m for m in bench.received if isinstance(m, Hello))
    avr.reset(cause)
    bench.received.clear()
    bench.now_us = 0
    bench.run(0.3)
    hello = next(m for m in bench.received if isinstance(m, Hello))
    assert hello.reset_cause == cause, how
    assert hello.session != first.session


def test_a_run_of_the_binary_repeats_to_the_bit(avr_tools: None) -> None:
    def said() -> bytes:
        board = AvrBoard()
        heard = b""
        for n in range(1, 400):
            board.imu(0, 0, 16384, 0, 0, n % 5)
            board.encoder_edges(n % 7, n % 3)
            for sonar in board.fired():
                board.echo(sonar, 900 + 10 * n)
            board.run(n * STEP_US)
            heard += board.serial_read()
        return heard

    assert said() == said()


def test_processor_and_memory_have_room(avr: AvrBoard) -> None:
    bench = driving(avr)
    bench.run(2.0)
    assert avr.busy_share < 0.7
    assert avr.worst_interrupt_latency_us < 2 * 10e6 / SERIAL_BAUD  # the hardware keeps two bytes of the line
    assert avr.untouched_ram > 2048


def test_memory_that_the_binary_reports_is_the_gap_below_the_stack(avr: AvrBoard) -> None:
    bench = Bench(avr)
    bench.run(1.0)
    reported = [m.free_ram for m in bench.received if isinstance(m, SimSta)][-1]
    assert avr.untouched_ram <= reported <= avr.untouched_ram + 300
