"""When the robot stands still for its gyro."""

from __future__ import annotations

from onboard.planner.driving.zero_velocity_update import REST_EVERY_S, REST_S, ZeroVelocityUpdate


def rested(until_s: float) -> ZeroVelocityUpdate:
    rest = ZeroVelocityUpdate()
    rest.due(until_s - REST_S - 0.1, standing=True)
    assert not rest.due(until_s, standing=True)
    return rest


def test_a_robot_that_drove_long_rests_until_it_has_stood_long_enough() -> None:
    rest = rested(10.0)
    assert not rest.due(10.0 + REST_EVERY_S, standing=False)
    begins_s = 10.1 + REST_EVERY_S
    assert rest.due(begins_s, standing=False)
    assert rest.due(begins_s + 0.5, standing=True)
    assert rest.due(begins_s + 0.4 + REST_S, standing=True)
    assert not rest.due(begins_s + 0.6 + REST_S, standing=True)


def test_standing_for_any_other_reason_is_a_rest_too() -> None:
    rest = rested(10.0)
    rest.due(50.0, standing=True)
    rest.due(50.1 + REST_S, standing=True)
    assert not rest.due(50.0 + REST_EVERY_S, standing=False)


def test_moments_of_standing_do_not_add_up() -> None:
    rest = rested(0.0)
    rest.due(1.0, standing=False)
    for i in range(20):
        rest.due(40.0 + i, standing=i % 2 == 0)
    assert rest.due(60.0, standing=False)
