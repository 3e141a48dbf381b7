"""Registration of wall points: what it recovers, what it does not pretend to know, and when it gives up."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from common.geometry import Points, Pose2
from onboard.mmu.front_end.scan_matching import Match, register


def wall(start: tuple[float, float], end: tuple[float, float], normal: tuple[float, float]) -> tuple[Points, Points]:
    """Points every 5 cm and their normals (away from the robot)."""
    count = int(np.hypot(end[0] - start[0], end[1] - start[1]) / 0.05)
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.array(start) * (1 - share) + np.array(end) * share, np.tile(np.array(normal), (count, 1))


def joined(*walls: tuple[Points, Points]) -> tuple[Points, Points]:
    return np.concatenate([w[0] for w in walls]), np.concatenate([w[1] for w in walls])


def corner() -> tuple[Points, Points]:
    return joined(wall((0.0, 2.0), (4.0, 2.0), (0.0, 1.0)), wall((4.0, -1.0), (4.0, 2.0), (1.0, 0.0)))


def hall() -> tuple[Points, Points]:
    return joined(wall((-3.0, 1.0), (3.0, 1.0), (0.0, 1.0)), wall((-3.0, -1.0), (3.0, -1.0), (0.0, -1.0)))


CENTRE = np.array([2.0, 0.5])


def displaced(points: Points, normals: Points, motion: Pose2) -> tuple[Points, Points]:
    """The set as a robot believes it whose pose is off by `motion` about CENTRE."""
    return motion.transform(points - CENTRE) + CENTRE, Pose2(0.0, 0.0, motion.heading_rad).transform(normals)


def matched(motion: Pose2, search_m: float, search_rad: float, noise_m: float = 0.0) -> Match | None:
    points, normals = corner()
    moved, turned = displaced(points, normals, motion)
    moved = moved + np.random.default_rng(1).normal(0.0, noise_m, moved.shape)
    return register(moved, turned, points, normals, CENTRE, search_m, search_rad)


@pytest.mark.requirement("MMU_MR_03")
@pytest.mark.parametrize(
    ("motion", "search_m"),
    [
        (Pose2(0.0, 0.0, 0.0), 0.0),
        (Pose2(0.08, -0.06, radians(1.0)), 0.0),
        (Pose2(0.08, -0.06, radians(-1.5)), 0.5),
        (Pose2(-0.5, 0.7, radians(3.0)), 1.0),
        (Pose2(1.3, -1.1, radians(-4.0)), 2.0),
    ],
)
def test_a_known_displacement_of_a_corner_is_undone(motion: Pose2, search_m: float) -> None:
    match = matched(motion, search_m, 0.04 + 0.04 * search_m, noise_m=0.01)
    assert match is not None
    left = match.correction.compose(motion)
    assert np.hypot(left.x_m, left.y_m) < 0.03
    assert abs(left.heading_rad) < radians(0.5)
    assert match.overlap > 0.9
    assert match.rms_m < 0.03
    assert np.linalg.eigvalsh(match.information).min() > 100.0


def test_along_a_bare_hall_a_match_knows_nothing() -> None:
    points, normals = hall()
    moved = points + np.array([0.3, 0.1])
    match = register(moved, normals, points, normals, np.zeros(2), 0.0, 0.0)
    assert match is not None
    assert match.correction.y_m == pytest.approx(-0.1, abs=0.01)
    along, across = match.information[0, 0], match.information[1, 1]
    assert along < 1e-3 * across


def test_a_hall_with_a_corner_at_its_end_knows_where_it_is() -> None:
    points, normals = joined(hall(), wall((3.0, -1.0), (3.0, 1.0), (1.0, 0.0)))
    match = register(points + np.array([0.1, 0.0]), normals, points, normals, np.zeros(2), 0.0, 0.0)
    assert match is not None
    assert match.correction.x_m == pytest.approx(-0.1, abs=0.02)
    assert match.information[0, 0] > 100.0


@pytest.mark.parametrize("search_m", [0.0, 1.0])
def test_sets_with_nothing_in_common_have_no_match(search_m: float) -> None:
    points, normals = corner()
    far, far_normals = wall((50.0, 50.0), (55.0, 50.0), (0.0, 1.0))
    assert register(points, normals, far, far_normals, CENTRE, search_m, 0.05) is None


def test_the_other_side_of_a_wall_is_not_the_same_wall() -> None:
    points, normals = corner()
    assert register(points, normals, points, -normals, CENTRE, 0.0, 0.0) is None


def test_a_repeating_pattern_is_ambiguous_and_a_corner_is_not() -> None:
    niches = joined(*(wall((x, 1.0), (x, 1.8), (1.0, 0.0)) for x in np.arange(-5.0, 6.0, 1.0)))
    few = joined(*(wall((x, 1.0), (x, 1.8), (1.0, 0.0)) for x in np.arange(-2.0, 3.0, 1.0)))
    repeated = register(*few, *niches, np.zeros(2), 2.0, 0.05)
    alone = matched(Pose2(0.3, 0.2, 0.0), 2.0, 0.05)
    assert repeated is not None
    assert alone is not None
    assert repeated.ambiguity > 0.9
    assert alone.ambiguity < repeated.ambiguity - 0.1


def every(step: int, first: int, points: Points, normals: Points) -> tuple[Points, Points]:
    return points[first::step], normals[first::step]


@pytest.mark.parametrize("step", [1, 10, 16])
def test_passes_that_met_the_same_walls_at_other_places_match_however_far_apart_their_echoes(step: int) -> None:
    """Of a slow sensor: one pass has its echoes 0.5 or 0.8 m apart, the other half way between them."""
    room = joined(corner(), wall((0.0, -1.0), (0.0, 2.0), (-1.0, 0.0)), wall((0.0, -1.0), (4.0, -1.0), (0.0, -1.0)))
    motion = Pose2(0.2, -0.15, radians(2.0))
    moved, turned = displaced(*every(step, step // 2, *room), motion)
    match = register(moved, turned, *every(step, 0, *room), CENTRE, 0.5, 0.06)
    assert match is not None
    left = match.correction.compose(motion)
    assert np.hypot(left.x_m, left.y_m) < 0.05
    assert abs(left.heading_rad) < radians(1.0)
    assert match.overlap > 0.8
