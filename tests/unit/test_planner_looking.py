"""When the robot has looked long enough."""

from __future__ import annotations

from common.geometry import Pose2
from onboard.planner.driving.looking import LOOK_S, TURN_TIMEOUT_S, Looking

EAST, NORTH = Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 1.57)


def test_a_look_is_over_when_the_robot_has_stood_turned_for_a_while() -> None:
    looking = Looking()
    looking.begin(NORTH.heading_rad, 10.0)
    assert not looking.over(EAST, 10.0)
    assert not looking.over(NORTH, 12.0)
    assert not looking.over(NORTH, 12.0 + LOOK_S - 0.1)
    assert looking.over(NORTH, 12.0 + LOOK_S + 0.1)


def test_a_look_at_what_cannot_be_turned_to_is_over_after_a_while() -> None:
    looking = Looking()
    looking.begin(NORTH.heading_rad, 10.0)
    assert not looking.over(EAST, 10.0 + TURN_TIMEOUT_S - 0.1)
    assert looking.over(EAST, 10.0 + TURN_TIMEOUT_S + 0.1)


def test_a_second_look_comes_before_the_end() -> None:
    looking = Looking()
    looking.begin(NORTH.heading_rad, 10.0, then_rad=EAST.heading_rad)
    assert not looking.over(NORTH, 10.0)
    assert not looking.over(NORTH, 10.1 + LOOK_S)
    assert looking.heading_rad == EAST.heading_rad
    assert not looking.over(EAST, 12.0)
    assert looking.over(EAST, 12.1 + LOOK_S)
