"""Which way round the robot turns about."""

from __future__ import annotations

from math import pi, radians

import pytest

from common.geometry import wrap_angle
from onboard.planner.driving.net_rotation_balancing import AHEAD_RAD, NetRotationBalancing


class Robot:
    """It turns as it is asked to, at most 6 deg between two commands; `wound_rad`: left turns less right turns."""

    def __init__(self, yaw_rad: float = 0.0) -> None:
        self.balancing = NetRotationBalancing()
        self.yaw_rad = yaw_rad
        self.net_rotation_rad = 0.0

    def face(self, yaw_rad: float, then_rad: float = 0.0) -> float:
        """Until it faces there; how far it turned, left positive."""
        before_rad = self.net_rotation_rad
        for _ in range(100):
            turn_rad = self.balancing.turn_rad(self.yaw_rad, wrap_angle(yaw_rad - self.yaw_rad), then_rad)
            assert abs(turn_rad) <= AHEAD_RAD
            step_rad = max(-radians(6.0), min(radians(6.0), turn_rad))
            self.yaw_rad = wrap_angle(self.yaw_rad + step_rad)
            self.net_rotation_rad += step_rad
        assert wrap_angle(yaw_rad - self.yaw_rad) == pytest.approx(0.0, abs=1e-9)
        return self.net_rotation_rad - before_rad


@pytest.mark.parametrize("first_rad", [radians(90.0), radians(-90.0)])
def test_turning_about_takes_back_what_was_turned_before(first_rad: float) -> None:
    robot = Robot(yaw_rad=2.0)
    robot.face(wrap_angle(2.0 + first_rad))
    robot.face(wrap_angle(2.0 + first_rad + pi))
    assert robot.net_rotation_rad == pytest.approx(-first_rad, abs=1e-9)


def test_turning_about_again_and_again_never_winds_up() -> None:
    robot = Robot()
    for turn in range(1, 12):
        robot.face(wrap_angle(turn * radians(175.0)))
        assert abs(robot.net_rotation_rad) <= pi


def test_the_next_turn_counts_too_where_it_is_known() -> None:
    for then_rad in (radians(90.0), radians(-90.0)):
        assert Robot().face(pi, then_rad) * then_rad < 0.0


@pytest.mark.parametrize("turn_rad", [radians(100.0), radians(-100.0)])
def test_a_turn_that_is_much_shorter_one_way_goes_that_way(turn_rad: float) -> None:
    robot = Robot()
    for _ in range(4):
        assert robot.face(wrap_angle(robot.yaw_rad + turn_rad)) == pytest.approx(turn_rad, abs=1e-9)
