"""How much the wheels slip, from their disagreement with the gyro."""

from __future__ import annotations

from math import radians, sqrt

import numpy as np
import pytest

from onboard.mmu.front_end.wheel_slip import SLIP_MIN_M_PER_SQRT_M, WheelSlip

TRACK_M, STEP_M = 0.23, 0.016


def drive(slip: WheelSlip, path_m: float, wheel_m_per_sqrt_m: float, left_longer: float = 0.0, seed: int = 0) -> None:
    """Straight, over a sill of 3 degrees every 30 m, which the gyro feels and the wheels do not."""
    rng = np.random.default_rng(seed)
    for i in range(round(path_m / STEP_M)):
        left_m, right_m = STEP_M + rng.normal(0.0, wheel_m_per_sqrt_m * sqrt(STEP_M), 2)
        gyro_rad = radians(3.0) if i % round(30.0 / STEP_M) == 100 else 0.0
        slip.drive(left_m * (1.0 + left_longer), right_m, gyro_rad)


@pytest.mark.parametrize("wheel_m_per_sqrt_m", [0.01, 0.03])
def test_slip_of_the_way_is_what_slip_of_two_wheels_makes_of_it(wheel_m_per_sqrt_m: float) -> None:
    found = []
    for seed in range(8):
        slip = WheelSlip(TRACK_M)
        drive(slip, 60.0, wheel_m_per_sqrt_m, left_longer=0.01, seed=seed)
        assert slip.along_m_per_sqrt_m is not None
        found.append(slip.along_m_per_sqrt_m)
    assert np.mean(found) == pytest.approx(wheel_m_per_sqrt_m / sqrt(2.0), rel=0.2)


def test_wheels_that_do_not_slip_are_believed_to_a_limit() -> None:
    slip = WheelSlip(TRACK_M)
    drive(slip, 20.0, 0.0)
    assert slip.along_m_per_sqrt_m == SLIP_MIN_M_PER_SQRT_M


def test_nothing_is_known_after_a_few_metres_or_of_turns() -> None:
    slip = WheelSlip(TRACK_M)
    drive(slip, 4.0, 0.01)
    assert slip.along_m_per_sqrt_m is None
    for _ in range(5000):
        slip.drive(-0.002, 0.002, 0.004 / TRACK_M)
    assert slip.along_m_per_sqrt_m is None
