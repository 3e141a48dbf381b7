"""Poses compose, invert and transform; angles wrap."""

from __future__ import annotations

from math import cos, isclose, pi, radians, sin

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose2, RightAngles, rigid_fit, wrap_angle, wrap_angles

LENGTHS = st.floats(-100.0, 100.0)
ANGLES = st.floats(-50.0, 50.0)
POSES = st.builds(Pose2, LENGTHS, LENGTHS, ANGLES)
POINTS = st.lists(st.tuples(LENGTHS, LENGTHS), min_size=1, max_size=8).map(np.array)


def same_pose(a: Pose2, b: Pose2) -> bool:
    turn = abs(wrap_angle(a.heading_rad - b.heading_rad))
    return a.distance_m(b) < 1e-9 * (1 + abs(a.x_m) + abs(a.y_m)) + 1e-9 and turn < 1e-9


@given(ANGLES)
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -pi < wrapped <= pi
    assert isclose(cos(wrapped), cos(angle), abs_tol=1e-9)
    assert isclose(sin(wrapped), sin(angle), abs_tol=1e-9)


def test_half_a_turn_is_positive() -> None:
    assert wrap_angle(pi) == pi
    assert wrap_angle(-pi) == pi
    assert wrap_angle(3 * pi) == pi


@given(st.lists(ANGLES))
def test_arrays_wrap_like_single_angles(angles: list[float]) -> None:
    single = np.array([wrap_angle(angle) for angle in angles])
    turned = np.abs(wrap_angles(angles) - single)
    assert np.all(np.minimum(turned, 2 * pi - turned) < 1e-12)


@given(POSES)
def test_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    here = Pose2(0.0, 0.0, 0.0)
    assert same_pose(pose.compose(pose.inverse()), here)
    assert same_pose(pose.inverse().compose(pose), here)


@given(POSES, POSES, POSES)
def test_composition_does_not_depend_on_brackets(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert same_pose(a.compose(b).compose(c), a.compose(b.compose(c)))


@given(POSES, POSES)
def test_going_from_one_pose_to_another_arrives_there(a: Pose2, b: Pose2) -> None:
    assert same_pose(a.compose(a.between(b)), b)


@given(POSES, POSES, POINTS)
def test_points_go_through_two_frames_as_through_their_composition(a: Pose2, b: Pose2, points: np.ndarray) -> None:
    np.testing.assert_allclose(a.compose(b).transform(points), a.transform(b.transform(points)), atol=1e-8)


@given(POSES, POINTS)
def test_transform_keeps_shape_and_distances(pose: Pose2, points: np.ndarray) -> None:
    moved = pose.transform(points)
    assert moved.shape == points.shape
    np.testing.assert_allclose(np.diff(moved, axis=0) ** 2 @ [1, 1], np.diff(points, axis=0) ** 2 @ [1, 1], atol=1e-6)


def test_bearing_is_positive_to_the_left() -> None:
    robot = Pose2(1.0, 1.0, pi / 2)
    assert isclose(robot.bearing_rad(0.0, 1.0), pi / 2)
    assert isclose(robot.bearing_rad(2.0, 1.0), -pi / 2)


@given(POSES)
def test_pose_survives_the_array_form(pose: Pose2) -> None:
    assert same_pose(Pose2.from_array(pose.as_array()), pose)


@given(POSES)
def test_rigid_fit_finds_the_motion_that_was_made(pose: Pose2) -> None:
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [-1.0, 2.0]])
    found = rigid_fit(corners, pose.transform(corners))
    np.testing.assert_allclose(found.transform(corners), pose.transform(corners), atol=1e-6)


@given(ANGLES, st.integers(-2, 2), st.floats(-0.7, 0.7))
def test_a_direction_is_measured_from_the_nearest_right_angle(base: float, quarters: int, off: float) -> None:
    angles = RightAngles().with_direction(base, 3.0).with_direction(base + pi / 2, 2.0)
    found = angles.offset_rad(base + quarters * pi / 2 + off)
    assert isclose(found, off, abs_tol=1e-9)


def test_directions_of_all_kinds_are_no_right_angles() -> None:
    angles = RightAngles()
    for i in range(12):
        angles = angles.with_direction(radians(15.0 * i))
    assert angles.share < 0.5
