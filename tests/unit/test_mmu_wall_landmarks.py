"""Straight pieces of wall: what counts as one, and which pieces are the same wall."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pytest

from common.geometry import FloatArray, Points, Pose2, wrap_angle
from onboard.mmu.back_end.wall_landmarks import Line, WallPiece, fit_piece


def echoes(
    normal_rad: float, offset_m: float, length_m: float, count: int = 60, noise_m: float = 0.01
) -> tuple[Points, FloatArray]:
    """Points on a wall with its foot `offset_m` away in direction `normal_rad`, and their noisy directions."""
    random = np.random.default_rng(5)
    n, along = np.array([cos(normal_rad), sin(normal_rad)]), np.array([-sin(normal_rad), cos(normal_rad)])
    s = np.linspace(-length_m / 2, length_m / 2, count)
    points = n * offset_m + s[:, None] * along + random.normal(0.0, noise_m, (count, 1)) * n
    return points, normal_rad + random.normal(0.0, radians(3.0), count)


@pytest.mark.parametrize("normal_deg", [90.0, -90.0, 0.0, 179.0, 35.0])
def test_echoes_of_a_wall_make_a_piece(normal_deg: float) -> None:
    piece = fit_piece(*echoes(radians(normal_deg), 1.2, 3.0))
    assert piece is not None
    assert abs(wrap_angle(piece.normal_rad - radians(normal_deg))) < radians(1.0)
    assert piece.middle @ [cos(radians(normal_deg)), sin(radians(normal_deg))] == pytest.approx(1.2, abs=0.01)
    assert piece.length_m == pytest.approx(3.0, abs=0.1)


def test_a_few_strays_do_not_turn_a_piece() -> None:
    points, directions = echoes(pi / 2, 1.2, 3.0)
    points[::10, 1] += 0.5
    piece = fit_piece(points, directions)
    assert piece is not None
    assert piece.normal_rad == pytest.approx(pi / 2, abs=radians(1.0))


@pytest.mark.parametrize(
    ("length_m", "count", "noise_m"), [(1.0, 60, 0.01), (3.0, 10, 0.01), (3.0, 60, 0.2), (3.0, 0, 0.01), (0.0, 60, 0.0)]
)
def test_short_sparse_or_rough_echoes_make_none(length_m: float, count: int, noise_m: float) -> None:
    assert fit_piece(*echoes(pi / 2, 1.2, length_m, count, noise_m)) is None


def test_a_step_in_the_wall_makes_no_piece() -> None:
    points, directions = echoes(pi / 2, 1.2, 3.0)
    points[30:, 1] += 0.16
    assert fit_piece(points, directions) is None


NORMAL = pi / 2
BEFORE = Line(np.array([0.0, 1.0]), NORMAL, 2.0)


def test_a_wall_that_continues_is_the_same_by_the_direction_of_the_wall() -> None:
    askew = Line(BEFORE.middle, NORMAL + radians(3.0), 2.0)  # a piece whose own direction is badly known
    assert Line(np.array([5.0, 1.1]), NORMAL, 2.0).continues(askew, NORMAL, radians(1.2))
    assert Line(np.array([5.0, 1.1]), NORMAL + radians(1.0), 2.0).continues(BEFORE, NORMAL, radians(1.2))


@pytest.mark.parametrize(
    ("middle", "normal_rad"),
    [
        ((5.0, 1.5), NORMAL),  # a wall set back
        ((5.0, 1.0), NORMAL + radians(2.0)),  # a bend
        ((5.0, 1.0), -NORMAL),  # the other side of it
        ((12.0, 1.0), NORMAL),  # too far on
    ],
)
def test_other_walls_are_not_the_same(middle: tuple[float, float], normal_rad: float) -> None:
    assert not Line(np.array(middle), normal_rad, 2.0).continues(BEFORE, NORMAL, radians(1.2))


def test_a_piece_moves_with_its_key_frame() -> None:
    line = Line(np.array([1.0, 2.0]), pi / 2, 2.0)
    moved = WallPiece.of(line, node=3, pose=Pose2(0.0, 0.0, 0.0), path_m=7.0).in_map(Pose2(10.0, 20.0, pi / 2))
    assert moved.middle == pytest.approx([8.0, 21.0])
    assert abs(moved.normal_rad) == pytest.approx(pi)
    again = WallPiece.of(moved, node=3, pose=Pose2(10.0, 20.0, pi / 2), path_m=7.0)
    assert (again.x_m, again.y_m, again.normal_rad) == pytest.approx((1.0, 2.0, pi / 2))
