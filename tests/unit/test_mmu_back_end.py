"""What the back end makes of walls at right angles and of a wall ahead."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.back_end.factors import Kind
from onboard.mmu.back_end.pose_graph import PoseGraph
from onboard.mmu.map.keyframes import Increment, KeyFrame

STEP_M = 0.4
WAY_M = 24.0
BEND_RAD = radians(0.2)  # per metre: how the gyro drifts
TRUE_M_PER_M = 1.006


def hall(bend_rad: float) -> list[Increment]:
    """Straight down a hall 2 m wide by odometry that bends; every true metre is 1 / 1.006 of it. One increment a metre.

    From 4 m to 8 m and from 14 m to 18 m, a wall ahead came nearer.
    """
    increments: list[Increment] = []
    frames: list[KeyFrame] = []
    echoes: list[list[float]] = []
    for i in range(round(WAY_M / STEP_M) + 1):
        way_m = i * STEP_M
        heading_rad = bend_rad * way_m
        at = np.array([np.cos(np.linspace(0, heading_rad, 50)).mean(), np.sin(np.linspace(0, heading_rad, 50)).mean()])
        odom = Pose2(float(at[0]) * way_m, float(at[1]) * way_m, heading_rad)
        frames.append(KeyFrame(2.5 * way_m, odom, way_m, way_m, heading_rad, 0.0))
        for k in range(8):
            for side in (1.0, -1.0):
                x_m = 0.05 * k
                echoes.append([i, way_m, x_m, side, side * pi / 2, 1.0])
        if i % 3 == 2:
            ends = [10.0 * k + 8.0 for k in range(2) if way_m - 1.2 < 10.0 * k + 8.0 <= way_m]
            rows = [approach(end - 4.0, end, left_m=1.0) for end in ends]
            approaches = np.array(rows, dtype=np.float64).reshape(-1, 8)
            rows_of = np.array(echoes)
            increments.append(Increment(tuple(frames), rows_of, np.zeros((0, 6)), approaches=approaches))
            frames, echoes = [], []
    return increments


def approach(from_m: float, to_m: float, left_m: float) -> list[float]:
    closer_m = TRUE_M_PER_M * (to_m - from_m)
    return [round(from_m / STEP_M), 0, 0, round(to_m / STEP_M), 0, 0, closer_m, left_m]


def corner(seen_ahead: bool) -> list[Increment]:
    """To the end of the hall, left, and on along the wall that was ahead; when `seen_ahead`, from 18 m to 20 m."""
    increments = [replace(increment, approaches=np.zeros((0, 8))) for increment in hall(0.0)]
    count, wall_m = sum(len(increment.frames) for increment in increments), TRUE_M_PER_M * WAY_M + 1.5
    if seen_ahead:
        row = approach(18.0, 20.0, left_m=wall_m - TRUE_M_PER_M * 20.0)
        increments[-1] = replace(increments[-1], approaches=np.array([row]))
    for i in range(count, count + 15):
        way_m = WAY_M + (i - count) * STEP_M
        odom = Pose2(WAY_M, way_m - WAY_M, pi / 2)
        frame = KeyFrame(2.5 * way_m + 2.0, odom, way_m, way_m + 0.5, pi / 2, 0.0)
        echoes = [[i, way_m + 0.5, 0.05 * k, -1.5, -pi / 2, 1.5] for k in range(8)]
        increments.append(Increment((frame,), np.array(echoes), np.zeros((0, 6))))
    return increments


def askew(by_rad: float) -> list[Increment]:
    """On for 12 m between walls that stand no longer at right angles; half way, the robot turns round once."""
    increments = hall(0.0)
    count = sum(len(increment.frames) for increment in increments)
    for i in range(count, count + 30):
        travel_m, turned_rad = i * STEP_M, 2 * pi * (i >= count + 15)
        way_m = travel_m + 0.2 * turned_rad
        frame = KeyFrame(2.5 * way_m, Pose2(travel_m, 0.0, 0.0), travel_m, way_m, turned_rad, 0.0)
        echoes = []
        for k in range(8):
            for side in (1.0, -1.0):
                aside_m = side + np.tan(by_rad) * (travel_m - WAY_M + 0.05 * k)
                echoes.append([i, way_m, 0.05 * k, aside_m, side * pi / 2 + by_rad, abs(aside_m)])
        increments.append(Increment((frame,), np.array(echoes), np.zeros((0, 6))))
    return increments


def graph_of(increments: list[Increment]) -> PoseGraph:
    back_end = BackEnd()
    for increment in increments:
        back_end.take(increment)
    return back_end._trail.graph


def poses(increments: list[Increment]) -> FloatArray:
    return graph_of(increments).poses


def test_a_straight_hall_keeps_the_heading_of_a_gyro_that_drifts() -> None:
    headings = poses(hall(BEND_RAD))[:, 2]
    assert abs(headings[-1] - headings[0]) < radians(1.0)


def test_each_straight_wall_counts_once_among_the_right_angles() -> None:
    graph = graph_of(hall(0.0))
    assert sorted(np.degrees(graph.walls_rad)) == pytest.approx([-90.0, 90.0], abs=0.2)
    assert graph.edges.of_kind(Kind.UPRIGHT).sum() == 2
    assert graph.edges.of_kind(Kind.BEARING).sum() > 20


def test_a_wall_off_the_right_angle_is_taken_for_none_even_after_the_robot_turned_round() -> None:
    """Then its heading is less certain, but the wall is the one that was judged before."""
    edges = graph_of(askew(radians(2.0))).edges
    pieces = edges.rows[edges.of_kind(Kind.BEARING)]
    upright = np.isin(pieces["slot"], edges.rows[edges.of_kind(Kind.UPRIGHT)]["slot"])
    way_m = pieces["second"] * STEP_M
    assert upright[way_m < WAY_M].sum() > 5
    assert upright[way_m < WAY_M].all()
    later = way_m > WAY_M + 4.0
    assert len(set(pieces["slot"][later])) == 2
    assert later.sum() > 5
    assert not upright[later].any()


@pytest.mark.requirement("MMU_MR_03")
def test_a_wall_ahead_corrects_the_length_of_the_way() -> None:
    way = poses(hall(0.0))
    end_m, driven_m = way[-1, 0], STEP_M * (len(way) - 1)
    assert 1.002 * driven_m < end_m < 1.0065 * driven_m


@pytest.mark.requirement("MMU_MR_03")
def test_a_wall_ahead_is_known_again_once_it_is_driven_along() -> None:
    """The sonar ahead saw it for 2 m only; the one beside tells where it is after 6."""
    short, long = (poses(corner(seen_ahead))[-1, 0] for seen_ahead in (False, True))
    assert short == pytest.approx(WAY_M, abs=0.01)
    assert long > WAY_M + 0.4 * (TRUE_M_PER_M - 1.0) * WAY_M
