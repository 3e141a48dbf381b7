"""The collision monitor: when it stops, when it backs off, and that nothing drives on towards something near."""

from __future__ import annotations

from math import inf, nan, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.constants import FOOTPRINT_RADIUS_M, PLANNER_CLEARANCE_M, SAFE_DISTANCE_M
from common.messages.motion import Speed
from onboard.planner.driving.collision_monitor import (
    BACK_OFF_S,
    BLOCKED_S,
    CollisionMonitor,
    Phase,
    nearest_ahead,
    stopping_m,
    watch,
)

CLEAR_AHEAD = (1.0, 3.0, 4.0, 3.0, 1.0)
NEAR_AHEAD = (1.0, 3.0, 0.25, 3.0, 1.0)
FORWARD = (Speed.MEDIUM, Speed.HIGH)
RANGES = st.tuples(*[st.floats(0.22, 6.5) | st.just(nan)] * 5)


def drives_forward(state: CollisionMonitor, wanted: Speed) -> bool:
    """What the Planner may let through: in any other phase it stops or backs off."""
    return state.phase is Phase.CLEAR and wanted in FORWARD


def is_near(ranges_m: tuple[float, ...]) -> bool:
    return nearest_ahead(ranges_m, 0.0)[0] < 0.0


@pytest.mark.requirement("PLN_MR_03")
@given(RANGES, st.sampled_from(Speed), st.floats(0.0, 0.5), st.sampled_from([Phase.CLEAR, Phase.STOPPED]))
def test_nothing_drives_forward_while_something_is_nearer_than_the_limit(
    ranges_m: tuple[float, ...], wanted: Speed, speed_m_s: float, phase: Phase
) -> None:
    state, _ = watch(CollisionMonitor(phase, 9.5), 10.0, wanted, ranges_m, speed_m_s)
    assert not (is_near(ranges_m) and drives_forward(state, wanted))


@given(RANGES, st.sampled_from(FORWARD), st.floats(0.0, 0.5))
def test_nothing_drives_forward_right_after_backing_off_while_something_is_near(
    ranges_m: tuple[float, ...], wanted: Speed, speed_m_s: float
) -> None:
    state, _ = watch(CollisionMonitor(Phase.BACKING, 0.0), 2 * BACK_OFF_S, wanted, ranges_m, speed_m_s)
    assert not (is_near(ranges_m) and drives_forward(state, wanted))


@settings(max_examples=50)
@given(st.lists(st.tuples(RANGES, st.sampled_from(Speed), st.floats(0.0, 0.5)), max_size=40))
def test_from_any_history_every_phase_follows_from_its_predecessor(
    history: list[tuple[tuple[float, ...], Speed, float]],
) -> None:
    """Clear -> stopped -> backing -> clear; an obstacle is announced exactly when backing begins."""
    allowed = {
        Phase.CLEAR: {Phase.CLEAR, Phase.STOPPED},
        Phase.STOPPED: {Phase.STOPPED, Phase.CLEAR, Phase.BACKING},
        Phase.BACKING: {Phase.BACKING, Phase.CLEAR, Phase.STOPPED},
    }
    state = CollisionMonitor()
    for i, (ranges_m, wanted, speed_m_s) in enumerate(history):
        before = state
        state, announced = watch(state, 0.2 * i, wanted, ranges_m, speed_m_s)
        assert state.phase in allowed[before.phase]
        assert announced == (before.phase is Phase.STOPPED and state.phase is Phase.BACKING)


def test_a_free_way_is_left_alone() -> None:
    assert watch(CollisionMonitor(), 1.0, Speed.HIGH, CLEAR_AHEAD, 0.3) == (CollisionMonitor(), False)


def test_something_near_stops_until_it_is_gone() -> None:
    state, announced = watch(CollisionMonitor(), 1.0, Speed.MEDIUM, NEAR_AHEAD, 0.16)
    assert state.phase is Phase.STOPPED
    assert not announced
    state, _ = watch(state, 1.0 + BLOCKED_S / 2, Speed.MEDIUM, NEAR_AHEAD, 0.0)
    assert state.phase is Phase.STOPPED
    state, announced = watch(state, 1.0 + BLOCKED_S, Speed.MEDIUM, CLEAR_AHEAD, 0.0)
    assert state.phase is Phase.CLEAR
    assert not announced


def test_something_that_stays_becomes_an_obstacle_and_is_backed_away_from_for_a_while() -> None:
    state, _ = watch(CollisionMonitor(), 1.0, Speed.MEDIUM, NEAR_AHEAD, 0.16)
    state, announced = watch(state, 1.1 + BLOCKED_S, Speed.MEDIUM, NEAR_AHEAD, 0.0)
    assert state.phase is Phase.BACKING
    assert announced
    since_s = 1.1 + BLOCKED_S
    state, announced = watch(state, since_s + BACK_OFF_S / 2, Speed.MEDIUM, NEAR_AHEAD, -0.16)
    assert state.phase is Phase.BACKING
    assert not announced
    state, _ = watch(state, since_s + 1.1 * BACK_OFF_S, Speed.MEDIUM, CLEAR_AHEAD, 0.0)
    assert state.phase is Phase.CLEAR


@pytest.mark.parametrize("wanted", [Speed.STOP, Speed.REVERSE])
def test_something_near_ahead_does_not_matter_to_a_robot_that_does_not_drive_there(wanted: Speed) -> None:
    assert watch(CollisionMonitor(), 1.0, wanted, NEAR_AHEAD, 0.0)[0].phase is Phase.CLEAR


def test_what_stands_beside_the_robot_is_not_ahead() -> None:
    assert nearest_ahead((0.23, nan, nan, nan, 0.23), 0.1) == (inf, 0.0)


def test_nearest_ahead_tells_how_much_room_is_left_and_the_side() -> None:
    room_m, bearing_rad = nearest_ahead((1.0, 0.5, 0.9, nan, 1.0), 0.0)
    assert room_m == pytest.approx(0.5 - FOOTPRINT_RADIUS_M - SAFE_DISTANCE_M)
    assert bearing_rad == pytest.approx(radians(45.0))


@pytest.mark.requirement("PLN_MR_03")
def test_the_edge_of_a_narrow_doorway_stops_nobody_who_drives_through_its_middle() -> None:
    """Hull and clearance fit: 0.34 m from the middle to either edge, which a slanted sonar hears until it is abeam."""
    edge = FOOTPRINT_RADIUS_M + PLANNER_CLEARANCE_M
    through = (nan, edge, nan, edge, nan)
    assert watch(CollisionMonitor(), 1.0, Speed.MEDIUM, through, 0.16)[0].phase is Phase.CLEAR
    assert watch(CollisionMonitor(), 1.0, Speed.MEDIUM, (nan, nan, edge, nan, nan), 0.16)[0].phase is Phase.STOPPED
    contact = (nan, FOOTPRINT_RADIUS_M + SAFE_DISTANCE_M, nan, nan, nan)
    assert watch(CollisionMonitor(), 1.0, Speed.MEDIUM, contact, 0.16)[0].phase is Phase.STOPPED


def test_silence_is_no_obstacle() -> None:
    assert watch(CollisionMonitor(), 1.0, Speed.MEDIUM, (nan,) * 5, 0.16)[0].phase is Phase.CLEAR


def test_the_faster_the_farther_off_it_stops() -> None:
    ranges_m = (nan, nan, FOOTPRINT_RADIUS_M + 0.30, nan, nan)
    assert watch(CollisionMonitor(), 1.0, Speed.MEDIUM, ranges_m, 0.16)[0].phase is Phase.CLEAR
    assert watch(CollisionMonitor(), 1.0, Speed.HIGH, ranges_m, 0.30)[0].phase is Phase.STOPPED


@given(st.floats(0.0, 0.5), st.floats(0.0, 0.5))
def test_stopping_distance_grows_with_the_speed(slow_m_s: float, more_m_s: float) -> None:
    assert 0.0 <= stopping_m(slow_m_s) <= stopping_m(slow_m_s + more_m_s)
    assert stopping_m(-0.16) == 0.0
