"""Straight segments of wall and the corners from which no echo came: what is inferred, and what never is."""

from __future__ import annotations

from math import atan2, cos, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.constants import MAP_DENSITY_PER_M
from common.geometry import FloatArray, Points, Pose2
from onboard.mmu.map.wall_segments import Rays, inferred_points, straight_walls

NO_RAYS = Rays(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
Echoes = tuple[Points, FloatArray]


def wall(x0: float, y0: float, x1: float, y1: float, spacing_m: float = 0.04, noise_m: float = 0.0) -> Echoes:
    """Echoes of a wall whose free side is on its left."""
    length_m = float(np.hypot(x1 - x0, y1 - y0))
    share = np.arange(0.0, length_m, spacing_m) / length_m
    points = np.column_stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0)])
    normal_rad = atan2(y1 - y0, x1 - x0) - pi / 2
    noise = np.random.default_rng(0).normal(0.0, noise_m, len(points))
    points += noise[:, None] * np.array([np.cos(normal_rad), np.sin(normal_rad)])
    return points, np.full(len(points), normal_rad)


def together(*walls: Echoes) -> Echoes:
    return np.concatenate([w[0] for w in walls]), np.concatenate([w[1] for w in walls])


# An inner corner at the origin: free where x < 0 and y > 0
FLOOR = wall(-5.0, 0.0, -0.8, 0.0, noise_m=0.02)
SIDE = wall(0.0, 0.9, 0.0, 5.0, noise_m=0.02)


def test_two_walls_that_end_before_an_inner_corner_are_closed_up_to_it() -> None:
    points = inferred_points(*together(FLOOR, SIDE), NO_RAYS)
    assert np.hypot(*points.T).min() < 0.05
    for axis, other, side in ((0, 1, -1.0), (1, 0, 1.0)):
        leg = np.sort(side * points[np.abs(points[:, other]) < 0.05][:, axis])
        assert leg[-1] > 0.7
        assert np.diff(leg[leg > -0.05]).max() <= 1.0 / MAP_DENSITY_PER_M + 1e-6
    on_a_wall = np.minimum(np.abs(points[:, 0]), np.abs(points[:, 1]))
    assert on_a_wall.max() < 0.05


def test_the_mouth_of_a_hall_stays_open() -> None:
    # The robot drove past the mouth, and its side sonar looked into the hall
    x_m = np.arange(-0.7, 0.0, 0.08)
    rays = Rays(np.column_stack([x_m, np.full(len(x_m), 1.0)]), np.full(len(x_m), -pi / 2), np.full(len(x_m), 4.0))
    assert len(inferred_points(*together(FLOOR, SIDE), rays)) == 0


def test_a_sonar_without_an_echo_where_a_wall_stood_near_keeps_a_mouth_open_too() -> None:
    x_m = np.arange(-0.7, 0.0, 0.08)
    rays = Rays(np.column_stack([x_m, np.full(len(x_m), 0.7)]), np.full(len(x_m), -pi / 2), np.full(len(x_m), np.inf))
    assert len(inferred_points(*together(FLOOR, SIDE), rays)) == 0


def test_rays_that_met_a_wall_at_a_flat_angle_prove_no_opening() -> None:
    x_m = np.arange(-2.0, -1.5, 0.04)
    rays = Rays(np.column_stack([x_m, np.full(len(x_m), 0.5)]), np.full(len(x_m), -0.35), np.full(len(x_m), 4.0))
    assert np.hypot(*inferred_points(*together(FLOOR, SIDE), rays).T).min() < 0.05


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (wall(0.0, -5.0, 0.0, -0.9), "an outer corner: free space runs round it"),
        (wall(0.0, 2.0, 0.0, 5.0), "too far from the corner"),
        (wall(0.0, -5.0, 0.0, 5.0), "the wall goes on behind the corner"),
        (wall(5.0, 0.0, 0.9, 0.0), "the other side of the same line"),
    ],
)
def test_what_is_no_corner_stays_open(other: Echoes, why: str) -> None:
    assert len(inferred_points(*together(FLOOR, other), NO_RAYS)) == 0, why


def test_a_wall_with_sparse_echoes_is_filled_to_the_density_of_the_map() -> None:
    clusters = together(*(wall(x_m, 0.0, x_m + 0.16, 0.0) for x_m in np.arange(-3.0, 0.0, 0.4).tolist()))
    both = np.concatenate([clusters[0], inferred_points(*clusters, NO_RAYS)])
    assert np.diff(np.sort(both[:, 0])).max() <= 1.0 / MAP_DENSITY_PER_M + 1e-6


def test_an_echo_alone_beside_the_end_of_a_wall_is_not_merged_with_it() -> None:
    stray: Echoes = (np.array([[-0.5, 0.0]]), np.array([-pi / 2]))
    assert len(inferred_points(*together(FLOOR, stray), NO_RAYS)) == 0


def test_a_short_wall_that_stands_nearly_square_to_a_long_one_is_closed_more_squarely_than_it_seems() -> None:
    off_m = 0.4 * tan(radians(6.0))
    crooked = wall(off_m, 0.7, -off_m, 1.5)
    corner = inferred_points(*together(FLOOR, crooked), NO_RAYS)
    assert corner[:, 0].max() < 0.6 * 1.1 * tan(radians(6.0))


def test_walls_that_stand_oblique_stay_so() -> None:
    leaning = wall(
        0.8 * sin(radians(30.0)), 0.8 * cos(radians(30.0)), 4.0 * sin(radians(30.0)), 4.0 * cos(radians(30.0))
    )
    points = inferred_points(*together(FLOOR, leaning), NO_RAYS)
    assert np.hypot(*points.T).min() < 0.05
    leg = points[points[:, 1] > 0.2]
    assert np.degrees(np.arctan2(leg[:, 0], leg[:, 1])) == pytest.approx(30.0, abs=5.0)


def test_the_two_sides_of_a_thin_wall_are_two_walls() -> None:
    walls = straight_walls(*together(wall(-5.0, 0.0, 0.0, 0.0), wall(0.0, -0.05, -5.0, -0.05)))
    assert len(walls) == 2
    assert walls[0].normal @ walls[1].normal < -0.99


def test_nothing_is_inferred_from_nothing() -> None:
    assert inferred_points(np.zeros((0, 2)), np.zeros(0), NO_RAYS).shape == (0, 2)


@given(x_m=st.floats(-50, 50), y_m=st.floats(-50, 50), heading_rad=st.floats(-pi, pi), seed=st.integers(0, 5))
def test_a_corner_is_closed_wherever_it_lies_and_however_it_is_turned(
    x_m: float, y_m: float, heading_rad: float, seed: int
) -> None:
    points, normals = together(FLOOR, SIDE)
    order = np.random.default_rng(seed).permutation(len(points))
    pose = Pose2(x_m, y_m, heading_rad)
    found = inferred_points(pose.transform(points)[order], (normals + heading_rad)[order], NO_RAYS)
    assert np.hypot(*(found - [x_m, y_m]).T).min() < 0.06
    assert 12 <= len(found) <= 40
