"""Tables P1.0 and P3.0, case by case."""

from __future__ import annotations

from math import degrees, nan, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.constants import HALL_WIDTH_FOR_BOTH_M, MIN_DISTANCE_POI_M, MIN_DISTANCE_TO_WALL_M
from onboard.planner.exploration.right_hand_rule import SHIFT_MAX_RAD, Turn, decide, shift_rad

DISTANCES = st.floats(0.22, 6.5) | st.just(nan)


@pytest.mark.requirement("PLN_MR_03", "PLN_MR_04")
@pytest.mark.parametrize(
    ("left_m", "right_m"),
    [
        (3.0, 0.5),  # nearer than both distances to the wall on the right, room on the left
        (3.0, 0.9),
        (3.0, 1.3),  # nearer than the camera wants it
        (1.3, 0.7),  # narrow: to the middle
        (nan, 0.6),  # no wall on the left
        (nan, 1.4),
    ],
)
def test_case_1_too_near_to_the_right_wall_shifts_left(left_m: float, right_m: float) -> None:
    assert 0.0 < shift_rad(left_m, right_m) <= SHIFT_MAX_RAD


@pytest.mark.requirement("PLN_MR_03")
@pytest.mark.parametrize(
    ("left_m", "right_m"),
    [
        (0.5, 3.0),
        (0.9, 1.7),
        (0.7, 1.3),  # narrow: to the middle
        (0.6, nan),
    ],
)
def test_case_2_too_near_to_the_left_wall_shifts_right(left_m: float, right_m: float) -> None:
    assert -SHIFT_MAX_RAD <= shift_rad(left_m, right_m) < 0.0


@pytest.mark.requirement("PLN_MR_03", "PLN_MR_04")
@pytest.mark.parametrize("half_m", [0.4, 0.8, 1.0, 1.2])
def test_case_3_in_the_middle_of_a_narrow_hall_does_not_shift(half_m: float) -> None:
    assert shift_rad(half_m, half_m) == 0.0


def test_far_off_the_aim_the_table_s_fifteen_degrees_are_asked() -> None:
    assert degrees(shift_rad(4.0, 0.4)) == pytest.approx(15.0)
    assert degrees(shift_rad(0.4, 4.0)) == pytest.approx(-15.0)


def test_with_no_wall_on_either_side_nothing_is_asked() -> None:
    assert shift_rad(nan, nan) == 0.0


def test_at_the_distance_of_the_camera_from_the_right_wall_nothing_is_asked() -> None:
    assert shift_rad(3.0, MIN_DISTANCE_POI_M) == 0.0
    assert shift_rad(nan, MIN_DISTANCE_POI_M) == 0.0


@given(DISTANCES, DISTANCES)
def test_never_more_than_fifteen_degrees(left_m: float, right_m: float) -> None:
    assert abs(shift_rad(left_m, right_m)) <= radians(15.0)


@pytest.mark.requirement("PLN_MR_03")
@given(DISTANCES, DISTANCES)
def test_a_wall_that_is_too_near_is_never_approached(left_m: float, right_m: float) -> None:
    shift = shift_rad(left_m, right_m)
    if right_m < MIN_DISTANCE_TO_WALL_M and not left_m <= right_m:
        assert shift >= 0.0
    if left_m < MIN_DISTANCE_TO_WALL_M and not right_m <= left_m:
        assert shift <= 0.0


def settled_m(width_m: float, right_m: float) -> float:
    """The distance to the right wall after driving on in a hall of that width by the table."""
    for _ in range(1600):
        right_m += 0.016 * shift_rad(width_m - right_m, right_m)
    return right_m


@pytest.mark.requirement("PLN_MR_03")
@settings(max_examples=30)
@given(st.floats(0.8, HALL_WIDTH_FOR_BOTH_M - 0.01), st.floats(0.05, 0.95))
def test_driving_by_the_table_ends_in_the_middle_of_a_narrow_hall(width_m: float, share: float) -> None:
    assert settled_m(width_m, width_m * share) == pytest.approx(width_m / 2, abs=0.05)


@pytest.mark.requirement("PLN_MR_04")
@settings(max_examples=30)
@given(st.floats(2 * MIN_DISTANCE_POI_M, 6.0), st.floats(0.05, 0.6))
def test_driving_by_the_table_ends_at_the_camera_s_distance_in_a_wide_hall(width_m: float, share: float) -> None:
    assert settled_m(width_m, width_m * share) == pytest.approx(MIN_DISTANCE_POI_M, abs=0.05)


@pytest.mark.parametrize("width_m", [2.55, 2.7, 2.85])
def test_driving_by_the_table_ends_at_the_camera_s_distance_in_a_hall_just_wide_enough(width_m: float) -> None:
    assert settled_m(width_m, 1.0) == pytest.approx(MIN_DISTANCE_POI_M, abs=0.05)


@pytest.mark.parametrize("width_m", [3.0, 5.0])
def test_driving_by_the_table_from_the_left_wall_does_not_stay_there(width_m: float) -> None:
    assert settled_m(width_m, width_m - 0.5) == pytest.approx(MIN_DISTANCE_POI_M, abs=0.05)


RIGHT, FORWARD, LEFT, BACK = Turn


@pytest.mark.requirement("PLN_MR_01", "PLN_MR_02")
@pytest.mark.parametrize(
    ("open_turns", "taken"),
    [
        pytest.param({FORWARD}, FORWARD, id="case 1: in a hall, on"),
        pytest.param({FORWARD, LEFT}, FORWARD, id="case 2: on, the left stays on the list"),
        pytest.param(set(), BACK, id="case 3: dead end, left twice"),
        pytest.param({LEFT}, LEFT, id="case 4: left (decision 34)"),
        pytest.param({RIGHT, LEFT}, RIGHT, id="case 5: right, the left stays on the list"),
        pytest.param({RIGHT}, RIGHT, id="case 6: right"),
        pytest.param({RIGHT, FORWARD, LEFT}, RIGHT, id="case 7: right, two stay on the list"),
        pytest.param({RIGHT, FORWARD}, RIGHT, id="case 8: right, the way ahead stays on the list"),
    ],
)
def test_every_junction_is_decided_as_the_table_says(open_turns: set[Turn], taken: Turn) -> None:
    assert decide(open_turns) is taken
