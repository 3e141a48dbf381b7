"""The Carrier on an ideal body: speeds, headings, Completed, backing off (CAR_MR_01..04)."""

from __future__ import annotations

import math

import pytest

from common.constants import ANGLE_ERROR_RAD, REVERSE_MAX_M, SAFE_DISTANCE_M, SPEED_ERROR_M_S
from offboard.simulator.electronics.board import HostBoard
from onboard.bridge.protocol import CarState
from tests.firmware.bench import Bench, ready_bench

FRONT_LEFT, FRONT = 1, 2
MEDIUM, HIGH, STOP = 1, 2, 0
PEGGED_US = 6 * 147


@pytest.mark.requirement("CAR_MR_02")
@pytest.mark.parametrize(("speed", "m_s"), [(MEDIUM, 0.16), (HIGH, 0.30)])
def test_robot_reaches_the_speed_within_one_centimetre_per_second(speed: int, m_s: float) -> None:
    bench = ready_bench()
    bench.drive(1, speed, 0.0)
    bench.run(2.5)
    for _ in range(200):
        bench.step()
        assert bench.speed_m_s == pytest.approx(m_s, abs=SPEED_ERROR_M_S)
    assert bench.car is not None
    assert bench.car.speed_mm_s == pytest.approx(m_s * 1000, abs=SPEED_ERROR_M_S * 1000)
    assert abs(bench.y_m) < 0.01


def test_speed_ramps_up_gently() -> None:
    bench = ready_bench()
    bench.drive(1, HIGH, 0.0)
    before = 0.0
    for _ in range(40):
        bench.run(0.05)
        assert bench.speed_m_s - before < 0.30 * 0.05 * 2
        before = bench.speed_m_s


@pytest.mark.requirement("CAR_MR_01", "CAR_MR_03")
@pytest.mark.parametrize("turn_deg", [16.0, -45.0, 90.0, -90.0, 179.0])
def test_robot_turns_on_the_spot_to_within_one_degree(turn_deg: float) -> None:
    bench = ready_bench()
    bench.drive(7, STOP, turn_deg)
    took_s = bench.run_until(lambda: bench.car.completed_id == 7)
    assert bench.heading_deg == pytest.approx(turn_deg, abs=math.degrees(ANGLE_ERROR_RAD))
    assert took_s < 2.0 + abs(turn_deg) / 45
    bench.run(1.0)
    assert bench.heading_deg == pytest.approx(turn_deg, abs=math.degrees(ANGLE_ERROR_RAD))
    assert math.hypot(bench.x_m, bench.y_m) < 0.01
    assert bench.pwm == (0, 0)


def test_turn_hardly_overshoots() -> None:
    bench = ready_bench()
    bench.drive(7, STOP, 90.0)
    highest = 0.0
    while bench.car.completed_id != 7:
        bench.step()
        highest = max(highest, bench.heading_deg)
        assert bench.now_us < 20_000_000
    assert highest < 91.0


def test_large_change_of_heading_stops_turns_completes_and_drives_on() -> None:
    bench = ready_bench()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(3.0)
    bench.drive(2, MEDIUM, 90.0)
    bench.run_until(lambda: bench.car.command_id == 2, 0.5)
    assert bench.car.completed_id == 1
    slowest = 1.0
    while bench.car.completed_id != 2:
        bench.step()
        slowest = min(slowest, abs(bench.speed_m_s))
        assert bench.now_us < 30_000_000
    assert slowest < 0.01
    assert bench.heading_deg == pytest.approx(90.0, abs=1.0)
    bench.run(3.0)
    assert bench.speed_m_s == pytest.approx(0.16, abs=0.01)


def test_small_corrections_replace_each_other_without_stopping() -> None:
    bench = ready_bench()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(3.0)
    for n in range(20):
        bench.drive(2 + n, MEDIUM, 10.0 if n % 2 else 4.0)
        bench.run(0.2)
        assert bench.speed_m_s > 0.13
    bench.run(2.0)
    assert bench.heading_deg == pytest.approx(10.0, abs=1.0)


def test_stop_command_stands_still() -> None:
    bench = ready_bench()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(2.0)
    bench.drive(2, STOP, 0.0)
    bench.run_until(lambda: bench.car.completed_id == 2, 3.0)
    assert abs(bench.speed_m_s) < 0.005
    assert bench.car.state == CarState.READY


@pytest.mark.requirement("CAR_MR_04")
def test_robot_backs_off_when_a_sonar_in_front_is_pegged() -> None:
    bench = ready_bench()
    bench.drive(5, MEDIUM, 0.0)
    bench.run(2.5)
    bench.echo_us[FRONT_LEFT] = PEGGED_US
    bench.run_until(lambda: bench.car.state == CarState.BACKING_OFF, 1.0)
    assert bench.car.aborted_id == 5
    start_m = bench.x_m
    fastest = 0.0
    for _ in range(150):
        bench.step()
        fastest = min(fastest, bench.speed_m_s)
    assert -0.085 < fastest < -0.06
    bench.echo_us[FRONT_LEFT] = 12 * 147
    bench.run_until(lambda: bench.car.state == CarState.READY, 2.0)
    assert bench.x_m < start_m
    here_m = bench.x_m
    bench.run(1.0)
    assert bench.x_m == pytest.approx(here_m, abs=0.005)


def test_backing_off_ends_after_the_floor_it_knows() -> None:
    bench = ready_bench()
    bench.drive(5, MEDIUM, 0.0)
    bench.run(5.0)
    bench.echo_us[FRONT] = PEGGED_US
    bench.run_until(lambda: bench.car.state == CarState.BACKING_OFF, 1.0)
    furthest = bench.x_m
    bench.run_until(lambda: bench.car.state == CarState.READY, 10.0)
    assert REVERSE_MAX_M - 0.15 < furthest - bench.x_m < REVERSE_MAX_M
    # It does not creep backwards with every further command
    bench.drive(6, MEDIUM, 0.0)
    here_m = bench.x_m
    bench.run(2.0)
    assert bench.car.aborted_id == 6
    assert bench.x_m == pytest.approx(here_m, abs=0.01)


@pytest.mark.requirement("CAR_MR_04")
def test_robot_backs_off_at_the_first_reading_of_what_it_saw_coming() -> None:
    bench = ready_bench()
    bench.drive(5, MEDIUM, 0.0)
    bench.echo_us[FRONT] = 11 * 147
    bench.run(2.5)
    bench.next_echo_us[FRONT] = PEGGED_US
    bench.run_until(lambda: not bench.next_echo_us)
    bench.run(0.02)
    assert bench.car.state == CarState.BACKING_OFF


@pytest.mark.requirement("CAR_MR_04")
@pytest.mark.parametrize("speed", [MEDIUM, HIGH])
def test_robot_stands_before_the_safe_distance_is_driven_up(speed: int) -> None:
    """From the first echo of something that nothing told of before."""
    bench = ready_bench()
    bench.drive(5, speed, 0.0)
    bench.run(2.5)
    bench.echo_us[FRONT] = bench.next_echo_us[FRONT] = PEGGED_US
    bench.run_until(lambda: not bench.next_echo_us)
    here_m = bench.x_m
    bench.run_until(lambda: bench.speed_m_s <= 0.0, 1.0)
    assert bench.x_m - here_m < SAFE_DISTANCE_M


@pytest.mark.parametrize(("speed", "m_s"), [(MEDIUM, 0.16), (HIGH, 0.30)])
def test_a_single_early_echo_costs_nothing(speed: int, m_s: float) -> None:
    bench = ready_bench()
    bench.drive(5, speed, 0.0)
    bench.run(2.5)
    bench.next_echo_us[FRONT] = PEGGED_US
    here_m = bench.x_m
    bench.run(1.0)
    assert not bench.next_echo_us
    assert bench.x_m - here_m == pytest.approx(m_s, abs=0.002)
    assert bench.car.aborted_id == 0
    assert bench.speed_m_s == pytest.approx(m_s, abs=0.01)


def test_robot_turns_away_from_a_wall_it_stands_at() -> None:
    bench = ready_bench()
    bench.echo_us[FRONT] = PEGGED_US
    bench.run(0.5)
    bench.drive(5, MEDIUM, 90.0)
    bench.run_until(lambda: bench.car.completed_id == 5 or bench.car.aborted_id == 5)
    assert bench.heading_deg == pytest.approx(90.0, abs=1.0)


@pytest.mark.parametrize("sense", ["bumper", "cliff"])
def test_bumper_and_cliff_back_the_robot_off(sense: str) -> None:
    bench = ready_bench()
    bench.drive(5, MEDIUM, 0.0)
    bench.run(2.5)

    def touch(on: bool) -> None:
        if sense == "bumper":
            bench.board.bumper(on)
        else:
            bench.board.cliff(on, False)

    touch(True)
    bench.run_until(lambda: bench.car.state == CarState.BACKING_OFF, 0.2)
    there_m = bench.x_m
    bench.run(0.5)
    assert bench.x_m - there_m < 0.03
    touch(False)
    bench.run_until(lambda: bench.car.state == CarState.READY, 5.0)
    assert bench.x_m < there_m
    assert bench.car.aborted_id == 5
    assert bench.car.error == (203 if sense == "bumper" else 204)


def test_dead_encoder_stops_the_robot() -> None:
    class NoLeftEncoder(HostBoard):
        def encoder_edges(self, left: int, right: int) -> None:
            super().encoder_edges(0, right)

    bench = Bench(NoLeftEncoder())
    bench.arm()
    bench.drive(1, MEDIUM, 0.0)
    bench.run_until(lambda: bench.car.error == 103, 3.0)
    assert bench.pwm == (0, 0)
