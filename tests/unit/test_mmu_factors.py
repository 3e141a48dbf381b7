"""Factors of the pose graph: each error is zero where its measurement is met, and each Jacobian is its derivative."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.calibration_priors import CalibrationPrior
from onboard.mmu.back_end.factors import FactorGroup
from onboard.mmu.back_end.pose_factors import HeadingChangeFactors, LoopClosureFactors, OdometryFactors
from onboard.mmu.back_end.robust_loss import CAUCHY, DCS, PHI, QUADRATIC, Loss
from onboard.mmu.back_end.states import Calibration, States
from onboard.mmu.back_end.wall_factors import OrthogonalityFactors, RangeToWallFactors, WallDirectionFactors

POSES = np.array([[0.1, -0.2, 0.3], [1.0, 0.4, 0.7], [1.9, 1.3, 1.2]])
CALIBRATION = Calibration(0.01, -0.02, 0.1, np.array([0.02, -0.03]), np.array([0.2, 1.8]))
STATES = States.of(POSES, CALIBRATION)
SHARP = np.diag([100.0, 200.0, 300.0])
STEP = 1e-6


def relative(first: int, second: int) -> Pose2:
    return Pose2.from_array(POSES[first]).between(Pose2.from_array(POSES[second]))


def odometry() -> FactorGroup:
    factors = OdometryFactors()
    factors.add(0, 1, Pose2(1.1, 0.3, 0.4), SHARP, 1.2, 0.4, 0)
    factors.add(1, 2, Pose2(1.2, 0.1, 0.5), SHARP, 1.3, -0.6, 1)
    factors.add(0, 2, Pose2(2.0, 1.0, 0.9), SHARP)  # not driven
    return factors


def loop_closure() -> FactorGroup:
    factors = LoopClosureFactors()
    factors.add(0, 2, Pose2(2.1, 0.9, 1.0), SHARP)
    return factors


def heading_change() -> FactorGroup:
    factors = HeadingChangeFactors()
    factors.add(0, 2, 0.8, 0.1)
    return factors


def wall_direction() -> FactorGroup:
    factors = WallDirectionFactors()
    factors.add(2, 1, 0.6, 0.1)
    factors.add(1, 0, 0.1, 0.2)
    return factors


def orthogonality() -> FactorGroup:
    factors = OrthogonalityFactors()
    factors.add(1, pi / 2, 0.1)
    return factors


def range_to_wall() -> FactorGroup:
    factors = RangeToWallFactors()
    factors.add(0, 2, np.array([0.8, 0.6]), 2.0, 0.01)
    return factors


def priors(step: float | None) -> tuple[FactorGroup, ...]:
    return CalibrationPrior(0.05, step, 0.01, 0.02).groups(STATES.layout)


ALL = [odometry(), loop_closure(), heading_change(), wall_direction(), orthogonality(), range_to_wall()]
ALL += [*priors(None), *priors(0.1)]


def name(group: FactorGroup) -> str:
    return type(group).__name__


@pytest.mark.parametrize("group", ALL, ids=name)
def test_a_jacobian_is_the_derivative_of_its_error(group: FactorGroup) -> None:
    columns, jacobian = group.columns(STATES.layout), group.jacobian(STATES)
    dense = np.zeros((*group.error(STATES).shape, STATES.layout.size))
    for factor, own in enumerate(columns):
        for k, column in enumerate(own.tolist()):
            dense[factor, :, column] += jacobian[factor, :, k]
    for column in range(STATES.layout.size):
        step = np.zeros(STATES.layout.size)
        step[column] = STEP
        numeric = (group.error(STATES.moved(step)) - group.error(STATES.moved(-step))) / (2 * STEP)
        assert dense[:, :, column] == pytest.approx(numeric, abs=1e-6)


@pytest.mark.parametrize("group", ALL, ids=name)
def test_chi_squared_is_the_error_weighed_by_the_information(group: FactorGroup) -> None:
    error, information = group.error(STATES), group.information
    expected = [float(e @ i @ e) for e, i in zip(error, information, strict=True)]
    assert group.chi2(STATES) == pytest.approx(expected)


def test_errors_are_zero_where_the_measurements_are_met() -> None:
    closure, walls = LoopClosureFactors(), WallDirectionFactors()
    closure.add(0, 2, relative(0, 2), SHARP)
    walls.add(2, 1, POSES[0, 2] + 1.8 - POSES[2, 2], 0.1)
    wall_ahead, orthogonal = RangeToWallFactors(), OrthogonalityFactors()
    wall_ahead.add(0, 2, np.array([1.0, 0.0]), relative(0, 2).x_m, 0.01)
    orthogonal.add(0, 0.1, 0.1)
    for group in (closure, walls, wall_ahead, orthogonal):
        assert group.chi2(STATES) == pytest.approx(0.0, abs=1e-20)


def test_odometry_is_met_where_the_path_is_longer_and_bends_as_the_calibration_has_it() -> None:
    calibration = Calibration(wheel_scale_error=0.01, drift_rad_per_m=np.array([radians(1.0)]))
    end = Pose2(2.02 * np.cos(radians(1.0)), 2.02 * np.sin(radians(1.0)), radians(2.0))
    factors = OdometryFactors()
    factors.add(0, 1, Pose2(2.0, 0.0, 0.0), SHARP, 2.0, 0.0, 0)
    states = States.of(np.array([[0.0, 0.0, 0.0], end.as_array()]), calibration)
    assert factors.chi2(states) == pytest.approx(0.0, abs=1e-9)


def test_the_newest_factors_alone_have_the_same_chi_squared() -> None:
    factors = LoopClosureFactors()
    for i in range(600):
        factors.add(0, 1, Pose2(0.01 * i, 0.0, 0.0), SHARP)
    assert factors.chi2_since(STATES, 590) == pytest.approx(factors.chi2(STATES)[590:])
    assert len(factors.chi2_since(STATES, 600)) == 0


@pytest.mark.parametrize("loss", [QUADRATIC, CAUCHY, DCS])
def test_a_small_chi_squared_costs_itself_and_weighs_in_full(loss: Loss) -> None:
    small = np.array([0.0, 1e-3 * PHI])
    assert loss.cost(small) == pytest.approx(small, rel=1e-3)
    assert loss.weight(small, PHI) == pytest.approx([1.0, 1.0], rel=2e-3)


@pytest.mark.parametrize(("loss", "most"), [(CAUCHY, 8 * PHI), (DCS, 3 * PHI)])
def test_a_large_chi_squared_costs_little_and_has_no_pull(loss: Loss, most: float) -> None:
    large: FloatArray = np.array([1000.0 * PHI])
    assert loss.cost(large)[0] < most
    assert loss.weight(large, PHI)[0] * large[0] ** 0.5 < 1.0
