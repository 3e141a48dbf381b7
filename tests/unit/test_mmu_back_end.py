"""What the back end makes of walls at right angles, of a wall ahead, and of a place visited before."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.back_end.exchange import Increment
from onboard.mmu.back_end.pose_graph import PoseGraph
from onboard.mmu.map.keyframes import Keyframe

STEP_M = 0.4
PATH_M = 24.0
BEND_RAD = radians(0.2)  # per metre: how the gyro drifts
TRUE_M_PER_M = 1.006


def hall(bend_rad: float) -> list[Increment]:
    """Straight down a hall 2 m wide by odometry that bends; every true metre is 1 / 1.006 of it. One increment a metre.

    From 4 m to 8 m and from 14 m to 18 m, a wall ahead came nearer.
    """
    increments: list[Increment] = []
    keyframes: list[Keyframe] = []
    echoes: list[list[float]] = []
    for i in range(round(PATH_M / STEP_M) + 1):
        path_m = i * STEP_M
        heading_rad = bend_rad * path_m
        at = np.array([np.cos(np.linspace(0, heading_rad, 50)).mean(), np.sin(np.linspace(0, heading_rad, 50)).mean()])
        odom = Pose2(float(at[0]) * path_m, float(at[1]) * path_m, heading_rad)
        keyframes.append(Keyframe(2.5 * path_m, odom, path_m, path_m, heading_rad, 0.0))
        for k in range(8):
            for side in (1.0, -1.0):
                x_m = 0.05 * k
                echoes.append([i, path_m, x_m, side, side * pi / 2, 1.0])
        if i % 3 == 2:
            ends = [10.0 * k + 8.0 for k in range(2) if path_m - 1.2 < 10.0 * k + 8.0 <= path_m]
            rows = [range_to_wall(end - 4.0, end, left_m=1.0) for end in ends]
            ranges_to_wall = np.array(rows, dtype=np.float64).reshape(-1, 8)
            rows_of = np.array(echoes)
            increments.append(Increment(tuple(keyframes), rows_of, np.zeros((0, 6)), ranges_to_wall=ranges_to_wall))
            keyframes, echoes = [], []
    return increments


def range_to_wall(from_m: float, to_m: float, left_m: float) -> list[float]:
    closer_m = TRUE_M_PER_M * (to_m - from_m)
    return [round(from_m / STEP_M), 0, 0, round(to_m / STEP_M), 0, 0, closer_m, left_m]


def corner(seen_ahead: bool) -> list[Increment]:
    """To the end of the hall, left, and on along the wall that was ahead; when `seen_ahead`, from 18 m to 20 m."""
    increments = [replace(increment, ranges_to_wall=np.zeros((0, 8))) for increment in hall(0.0)]
    count, wall_m = sum(len(increment.keyframes) for increment in increments), TRUE_M_PER_M * PATH_M + 1.5
    if seen_ahead:
        row = range_to_wall(18.0, 20.0, left_m=wall_m - TRUE_M_PER_M * 20.0)
        increments[-1] = replace(increments[-1], ranges_to_wall=np.array([row]))
    for i in range(count, count + 15):
        path_m = PATH_M + (i - count) * STEP_M
        odom = Pose2(PATH_M, path_m - PATH_M, pi / 2)
        keyframe = Keyframe(2.5 * path_m + 2.0, odom, path_m, path_m + 0.5, pi / 2, 0.0)
        echoes = [[i, path_m + 0.5, 0.05 * k, -1.5, -pi / 2, 1.5] for k in range(8)]
        increments.append(Increment((keyframe,), np.array(echoes), np.zeros((0, 6))))
    return increments


def askew(by_rad: float) -> list[Increment]:
    """On for 12 m between walls that stand no longer at right angles; at the middle, the robot turns round once."""
    increments = hall(0.0)
    count = sum(len(increment.keyframes) for increment in increments)
    for i in range(count, count + 30):
        travel_m, turned_rad = i * STEP_M, 2 * pi * (i >= count + 15)
        path_m = travel_m + 0.2 * turned_rad
        keyframe = Keyframe(2.5 * path_m, Pose2(travel_m, 0.0, 0.0), travel_m, path_m, turned_rad, 0.0)
        echoes = []
        for k in range(8):
            for side in (1.0, -1.0):
                aside_m = side + np.tan(by_rad) * (travel_m - PATH_M + 0.05 * k)
                echoes.append([i, path_m, 0.05 * k, aside_m, side * pi / 2 + by_rad, abs(aside_m)])
        increments.append(Increment((keyframe,), np.array(echoes), np.zeros((0, 6))))
    return increments


def graph_of(increments: list[Increment]) -> PoseGraph:
    back_end = BackEnd()
    for increment in increments:
        back_end.take(increment)
    return back_end._keyframes.graph


def poses(increments: list[Increment]) -> FloatArray:
    return graph_of(increments).poses


def test_a_straight_hall_keeps_the_heading_of_a_gyro_that_drifts() -> None:
    headings = poses(hall(BEND_RAD))[:, 2]
    assert abs(headings[-1] - headings[0]) < radians(1.0)


def test_each_straight_wall_counts_once_among_the_right_angles() -> None:
    graph = graph_of(hall(0.0))
    assert sorted(np.degrees(graph.calibration.wall_normals_rad)) == pytest.approx([-90.0, 90.0], abs=0.2)
    assert len(graph.orthogonality) == 2
    assert len(graph.wall_directions) > 20


def test_a_wall_off_the_right_angle_is_taken_for_none_even_after_the_robot_turned_round() -> None:
    """Then its heading is less certain, but the wall is the one that was judged before."""
    graph = graph_of(askew(radians(2.0)))
    pieces = graph.wall_directions.rows
    orthogonal = np.isin(pieces["wall"], graph.orthogonality.rows["wall"])
    path_m = pieces["node"] * STEP_M
    assert orthogonal[path_m < PATH_M].sum() > 5
    assert orthogonal[path_m < PATH_M].all()
    later = path_m > PATH_M + 4.0
    assert len(set(pieces["wall"][later])) == 2
    assert later.sum() > 5
    assert not orthogonal[later].any()


@pytest.mark.requirement("MMU_MR_03")
def test_a_wall_ahead_corrects_the_length_of_the_path() -> None:
    path = poses(hall(0.0))
    end_m, driven_m = path[-1, 0], STEP_M * (len(path) - 1)
    assert 1.002 * driven_m < end_m < 1.0065 * driven_m


@pytest.mark.requirement("MMU_MR_03")
def test_a_wall_ahead_is_recognised_once_it_is_driven_along() -> None:
    """The sonar ahead saw it for 2 m only; the one beside shows where it is after 6."""
    short, long = (poses(corner(seen_ahead))[-1, 0] for seen_ahead in (False, True))
    assert short == pytest.approx(PATH_M, abs=0.01)
    assert long > PATH_M + 0.4 * (TRUE_M_PER_M - 1.0) * PATH_M
