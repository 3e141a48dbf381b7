"""Backwards no sensor looks: only over floor that was driven just now, whatever is asked for (decision 23)."""

from __future__ import annotations

from collections import deque
from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.constants import REVERSE_MAX_M, SPEED_ERROR_M_S
from onboard.bridge.protocol import CarState
from tests.firmware.bench import STEP_S, Bench, ready_bench

FRONT = 2
MEDIUM, HIGH, STOP, REVERSE = 1, 2, 0, -1
PEGGED_US = 6 * 147
FRESH_S = 10.5  # and braking
ASIDE_M = 0.12
TURNING_M_S = 0.03  # a turn on the spot keeps its centre
ON_THE_SPOT_M = 0.01


def driven_bench(seconds: float = 6.0) -> Bench:
    """It drove straight on just now."""
    bench = ready_bench()
    bench.drive(1, MEDIUM, 0.0)
    bench.run(seconds)
    return bench


def moved_m(bench: Bench, seconds: float) -> float:
    x_m, y_m = bench.x_m, bench.y_m
    bench.run(seconds)
    return hypot(bench.x_m - x_m, bench.y_m - y_m)


@pytest.mark.requirement("CAR_MR_02")
def test_robot_reaches_its_speed_backwards_within_one_centimetre_per_second() -> None:
    bench = driven_bench()
    bench.drive(2, REVERSE, 0.0)
    bench.run(1.5)
    for _ in range(200):
        bench.step()
        assert bench.speed_m_s == pytest.approx(-0.16, abs=SPEED_ERROR_M_S)


def test_robot_goes_back_almost_half_a_metre_and_then_stands_with_the_command_in_force() -> None:
    bench = driven_bench()
    furthest_m = bench.x_m
    bench.drive(2, REVERSE, 0.0)
    bench.run_until(lambda: bench.speed_m_s < -0.1, 3.0)
    bench.run_until(lambda: bench.pwm == (0, 0), 5.0)
    assert REVERSE_MAX_M - 0.15 < furthest_m - bench.x_m < REVERSE_MAX_M
    assert moved_m(bench, 5.0) < ON_THE_SPOT_M
    assert (bench.car.command_id, bench.car.aborted_id) == (2, 0)


@pytest.mark.parametrize("between", [MEDIUM, STOP])
@pytest.mark.parametrize(("back_s", "between_s"), [(1.0, 0.1), (3.0, 0.3), (4.0, 1.0)])
def test_forwards_and_backwards_by_turns_never_lead_further_back_than_half_a_metre(
    between: int, back_s: float, between_s: float
) -> None:
    bench = driven_bench()
    furthest_m = backmost_m = bench.x_m
    for turn in range(8):
        for command_id, speed, seconds in ((2, REVERSE, back_s), (3, between, between_s)):
            bench.drive(10 * turn + command_id, speed, 0.0)
            bench.run(seconds)
            furthest_m, backmost_m = max(furthest_m, bench.x_m), min(backmost_m, bench.x_m)
    assert 0.2 < furthest_m - backmost_m < REVERSE_MAX_M


def test_after_a_turn_on_the_spot_nothing_known_lies_behind() -> None:
    bench = driven_bench()
    bench.drive(2, STOP, 90.0)
    bench.run_until(lambda: bench.car.completed_id == 2)
    bench.drive(3, REVERSE, 90.0)
    assert moved_m(bench, 3.0) < ON_THE_SPOT_M
    assert (bench.car.command_id, bench.car.aborted_id) == (3, 0)


def test_floor_that_was_driven_long_ago_is_not_known() -> None:
    bench = driven_bench()
    bench.drive(2, STOP, 0.0)
    bench.run(12.0)
    bench.drive(3, REVERSE, 0.0)
    assert moved_m(bench, 3.0) < ON_THE_SPOT_M


def test_after_a_short_stand_the_floor_behind_is_still_known() -> None:
    bench = driven_bench()
    bench.drive(2, STOP, 0.0)
    bench.run(3.0)
    bench.drive(3, REVERSE, 0.0)
    assert moved_m(bench, 3.0) > 0.3


def test_after_power_on_nothing_known_lies_behind() -> None:
    bench = ready_bench()
    bench.drive(1, REVERSE, 0.0)
    assert moved_m(bench, 3.0) < ON_THE_SPOT_M


@pytest.mark.requirement("CAR_MR_04")
def test_contact_right_after_a_turn_is_stood_up_to_and_turned_away_from() -> None:
    bench = driven_bench()
    bench.drive(2, STOP, 90.0)
    bench.run_until(lambda: bench.car.completed_id == 2)
    bench.echo_us[FRONT] = PEGGED_US
    bench.drive(3, MEDIUM, 90.0)
    bench.run_until(lambda: bench.car.aborted_id == 3, 3.0)
    assert moved_m(bench, 2.0) < ON_THE_SPOT_M
    assert bench.car.state == CarState.READY
    bench.drive(4, STOP, 0.0)
    bench.run_until(lambda: bench.car.completed_id == 4, 6.0)


COMMANDS = st.tuples(
    st.sampled_from([MEDIUM, HIGH, STOP, REVERSE, REVERSE, REVERSE]),
    st.sampled_from([0.0, 0.0, 0.0, 10.0, -14.0, 40.0, 180.0]),
    st.sampled_from([0.2, 1.0, 3.0]),
)


@settings(max_examples=15, deadline=None)
@given(st.lists(COMMANDS, min_size=4, max_size=16))
def test_whatever_is_asked_for_the_robot_backs_only_over_what_it_drove_just_now(
    commands: list[tuple[int, float, float]],
) -> None:
    bench = ready_bench()
    driven = deque([(0.0, 0.0, 0.0)])  # when and where it drove forwards
    heading_deg = back_m = 0.0
    for command_id, (speed, turn_deg, seconds) in enumerate([(MEDIUM, 0.0, 3.0), *commands], 1):
        heading_deg += turn_deg
        bench.drive(command_id, speed, heading_deg)
        for _ in range(round(seconds / STEP_S)):
            bench.step()
            now_s = bench.now_us / 1e6
            back_m = max(back_m - bench.speed_m_s * STEP_S, 0.0)
            assert back_m < REVERSE_MAX_M
            if bench.speed_m_s > 0.0:
                driven.append((now_s, bench.x_m, bench.y_m))
            elif bench.speed_m_s < -TURNING_M_S:
                while driven[0][0] < now_s - FRESH_S:
                    driven.popleft()
                assert min(hypot(bench.x_m - x_m, bench.y_m - y_m) for _, x_m, y_m in driven) < ASIDE_M
