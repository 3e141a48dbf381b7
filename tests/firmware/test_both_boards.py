"""Host build and AVR binary in the building with realistic errors: speed, heading, turns, rhythm, likeness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import hypot, inf
from typing import Any

import pytest

from common.messages.motion import Speed
from offboard.simulator.electronics.avr_board import AvrBoard
from offboard.simulator.electronics.board import Board, HostBoard
from offboard.simulator.error_profiles import PROFILES
from onboard.bridge.protocol import CarSta, Dst, Odo, Rng, SimSta
from tests.firmware.course import Course, hall, open_hall

# A sill turns the body by up to 3 degrees under wheels that held still; what comes after it is a test of its own
SMOOTH_FLOOR = replace(PROFILES["realistic"], bump_spacing_m=inf)

MakeBoard = Callable[[], Board]


def off_heading_deg(odo: Odo) -> float:
    return ((odo.yaw_cdeg + 18000) % 36000 - 18000) / 100.0


@pytest.mark.requirement("CAR_MR_02", "CAR_MR_03")
def test_robot_holds_speed_and_heading_for_a_minute(make_board: MakeBoard) -> None:
    course = Course(make_board(), 1, SMOOTH_FLOOR)
    course.get_ready()
    course.at(4.0)
    course.link.drive(Speed.MEDIUM, 0.0)
    course.at(7.0)
    course.messages.clear()
    while course.now_s < 60.0:
        course.step()
        assert course.world.true_motion[0] == pytest.approx(0.16, abs=0.01)
        assert course.heading_deg == pytest.approx(0.0, abs=1.0)
    reports = [m for m in course.messages if isinstance(m, Odo)]
    assert all(abs(odo.speed_mm_s - 160) <= 10 for odo in reports)
    assert all(abs(off_heading_deg(odo)) <= 1.0 for odo in reports)


def minute_after_a_standstill(board: Board, seed: int, floor: Any = None) -> Course:
    course = Course(board, seed, SMOOTH_FLOOR, floor=floor)
    course.get_ready()
    course.at(4.0)
    course.link.drive(Speed.MEDIUM, 0.0)
    course.at(64.0)
    return course


@pytest.mark.parametrize("seed", range(10))
def test_true_heading_is_within_a_degree_a_minute_after_a_standstill(seed: int) -> None:
    assert minute_after_a_standstill(HostBoard(), seed).heading_deg == pytest.approx(0.0, abs=1.0)


def bow_hall() -> Any:
    xs = [0.5 * i for i in range(41)]
    middle = [(x, (x - 2.0) ** 2 / 120.0) for x in xs]  # radius 60 m
    return hall([(x, y - 0.9) for x, y in middle] + [(x, y + 0.9) for x, y in reversed(middle)], (2.0, 0.0))


def zigzag_hall() -> Any:
    bends_m = (0.1, -0.2, 0.3, 0.0, -0.3, 0.2, -0.1, 0.3, -0.2, 0.1, 0.0)
    right = [(2.0 * i, -1.0 + bend_m) for i, bend_m in enumerate(bends_m)]
    left = [(2.0 * i, 1.2 + bend_m) for i, bend_m in enumerate(reversed(bends_m))]
    return hall(right + left[::-1], (2.0, 0.1))


@pytest.mark.parametrize("floor", [bow_hall, zigzag_hall], ids=["bow", "zigzag"])
@pytest.mark.parametrize("seed", range(3))
def test_walls_that_are_not_straight_mislead_nobody(floor: Callable[[], Any], seed: int) -> None:
    """Out of reach of every wall the gyro is alone; bent walls may not make it worse."""
    alone = minute_after_a_standstill(HostBoard(), seed, open_hall(40, 16))
    beside = minute_after_a_standstill(HostBoard(), seed, floor())
    assert beside.heading_deg == pytest.approx(alone.heading_deg, abs=0.25)


@pytest.mark.parametrize("seed", range(4))
def test_yaw_without_what_walls_told_is_that_of_a_gyro_alone(seed: int) -> None:
    errors_deg = []
    for floor in (open_hall(40, 16), open_hall(20, 6), zigzag_hall()):
        course = minute_after_a_standstill(HostBoard(), seed, floor)
        assert course.link.odo is not None
        plain_deg = off_heading_deg(course.link.odo) - course.link.odo.by_walls_cdeg / 100.0
        errors_deg.append(plain_deg - course.heading_deg)
    assert errors_deg == pytest.approx([errors_deg[0]] * 3, abs=0.05)


def test_robot_is_back_on_its_heading_soon_after_a_sill() -> None:
    course = Course(HostBoard(), 3, replace(PROFILES["realistic"], bump_spacing_m=2.0))
    course.get_ready()
    course.at(4.0)
    course.link.drive(Speed.MEDIUM, 0.0)
    course.at(7.0)
    course.messages.clear()
    course.at(60.0)
    off = [abs(off_heading_deg(m)) > 1.0 for m in course.messages if isinstance(m, Odo)]
    assert any(off)
    longest = run = 0
    for beyond in off:
        run = run + 1 if beyond else 0
        longest = max(longest, run)
    assert longest <= 5


@pytest.mark.requirement("CAR_MR_01")
def test_a_turn_on_the_spot_stays_on_the_spot(make_board: MakeBoard) -> None:
    course = Course(make_board(), 2)
    course.get_ready()
    course.at(4.0)
    for turn_deg in (90.0, 0.0, -90.0):
        before = course.world.truth
        course.turn(turn_deg)
        course.at(course.now_s + 0.5)
        assert before.distance_m(course.world.truth) <= 0.02
        assert course.heading_deg == pytest.approx(turn_deg, abs=1.0)


@pytest.mark.requirement("SIM_MR_01", "SIM_MR_05")
def test_reports_come_ten_times_a_second(make_board: MakeBoard) -> None:
    course = Course(make_board(), 1)
    course.get_ready()
    course.messages.clear()
    begin_s = course.now_s
    course.link.drive(Speed.MEDIUM, 0.0)
    course.at(begin_s + 10.0)
    for kind in (Odo, Rng, Dst, SimSta):
        assert len([m for m in course.messages if isinstance(m, kind)]) == pytest.approx(100, abs=2), kind
    assert len([m for m in course.messages if isinstance(m, CarSta)]) >= 98
    numbers = [m.seq for m in course.messages if isinstance(m, Odo)]
    assert all(b - a == 1 for a, b in pairwise(numbers))


Way = list[tuple[float, float, float, float]]  # t_s, x_m, y_m, heading_rad


def minute_of_commands(board: Board, seed: int, later_s: float = 0.0) -> Way:
    """Straight on, a turn, a slow swerve, backwards over it, a turn, fast."""
    course = Course(board, seed, SMOOTH_FLOOR, floor=open_hall(12, 12))
    course.get_ready()
    for at_s, speed, yaw_deg in (
        (4.0, Speed.MEDIUM, 0.0),
        (14.0, Speed.MEDIUM, 90.0),
        (27.0, Speed.MEDIUM, 97.0),
        (35.0, Speed.REVERSE, 97.0),
        (37.0, Speed.STOP, 0.0),
        (44.0, Speed.HIGH, 8.0),
        (56.0, Speed.STOP, 8.0),
    ):
        course.at(at_s + later_s)
        course.link.drive(speed, yaw_deg)
    course.at(60.0)
    assert course.world.contacts == 0
    return course.world.truth_log


def most_apart_m(one: Way, other: Way) -> float:
    return max(hypot(a[1] - b[1], a[2] - b[2]) for a, b in zip(one, other, strict=True))


def test_both_boards_drive_the_same_way(avr_tools: None) -> None:
    assert most_apart_m(minute_of_commands(HostBoard(), 4), minute_of_commands(AvrBoard(), 4)) < 0.02


@pytest.mark.parametrize("seed", range(1, 5))
def test_commands_a_tick_later_lead_the_same_way(seed: int) -> None:
    """Neither slip that falls on the other wheel nor an echo heard by one of them alone parts their ways."""
    now, later = minute_of_commands(HostBoard(), seed), minute_of_commands(HostBoard(), seed, 0.01)
    assert most_apart_m(now, later) < 0.02


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_commands_and_their_ends_survive_a_line_that_loses_lines(seed: int) -> None:
    """One bit in 4000 is wrong: every tenth report is lost and every twentieth command, and now and then so many
    heartbeats in a row that the robot stops. Whatever happens to a command, its end is told."""
    course = Course(HostBoard(), seed, replace(PROFILES["none"], serial_bit_error_rate=2.5e-4))
    course.get_ready()
    for turn in range(1, 9):
        ends = ""
        while ends != "completed":
            command = course.link.drive(Speed.STOP, turn * 45.0)
            course.until(lambda c=command: course.link.completed(c) or course.link.aborted(c), 15.0)
            ends = "completed" if course.link.completed(command) else "aborted"
        assert (course.heading_deg - turn * 45.0 + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1.0)
    assert course.link.bad_lines > 20
