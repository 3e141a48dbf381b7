"""Sequential scan matching, and whether a gyro leads odometry, by walls that seem to turn."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.back_end.exchange import Increment
from onboard.mmu.back_end.heading_drift import apparent_turn
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.odometry_noise import UNKNOWN, WHEELS_ALONE
from onboard.mmu.back_end.sequential_matching import TURN_PATH_M, SequentialMatching
from onboard.mmu.map.keyframes import Keyframe

RNG = np.random.default_rng(7)


def beside_walls(turn_rad_per_m: float, noise_rad: float = radians(2.0)) -> tuple[FloatArray, FloatArray]:
    """Paths and normals of echoes on two walls, a third crossing them, in a keyframe that turns as it goes."""
    paths_m = np.sort(RNG.uniform(0.0, 5.0, 150))
    walls_rad = RNG.choice([pi / 2, -pi / 2, 0.1], 150)
    return paths_m, walls_rad + turn_rad_per_m * paths_m + RNG.normal(0.0, noise_rad, 150)


@pytest.mark.parametrize("turn_deg_per_m", [-3.0, 0.0, 2.0])
def test_walls_that_seem_to_turn_are_measured(turn_deg_per_m: float) -> None:
    measured = apparent_turn(*beside_walls(radians(turn_deg_per_m)))
    assert measured == pytest.approx(radians(turn_deg_per_m), abs=radians(0.3))


def test_a_few_echoes_measure_nothing() -> None:
    assert apparent_turn(np.linspace(0.0, 3.0, 12), np.full(12, 1.0)) is None
    assert apparent_turn(np.zeros(0), np.zeros(0)) is None


def drive(turn_rad_per_m: float, length_m: float) -> list[Increment]:
    """Straight down a hall 2 m wide; odometry turns as it goes. One increment a metre."""
    increments = []
    for metre in range(round(length_m)):
        keyframes, rows = [], []
        for k in range(2):
            path_m = metre + 0.5 * k
            turned_rad = turn_rad_per_m * path_m
            steps = np.linspace(0.0, turned_rad, 50)
            odom = Pose2(float(np.cos(steps).mean()) * path_m, float(np.sin(steps).mean()) * path_m, turned_rad)
            keyframes.append(Keyframe(3.0 * path_m, odom, path_m, path_m, turned_rad, 0.0))
            for x_m in np.arange(0.0, 0.5, 0.05):
                for side in (1.0, -1.0):
                    rows.append([2 * metre + k, path_m + x_m, x_m, side, side * pi / 2, 1.0])
        increments.append(Increment(tuple(keyframes), np.array(rows), np.zeros((0, 6))))
    return increments


@pytest.mark.parametrize("turn_deg_per_m", [0.0, 4.0])
def test_the_heading_is_right_whether_odometry_turns_away_or_not(turn_deg_per_m: float) -> None:
    back_end = BackEnd(gyro_led=False)
    for increment in drive(radians(turn_deg_per_m), 20.0):
        headings = back_end.take(increment).poses[:, 2]
    assert np.degrees(np.ptp(headings[-20:])) < 4.0


def test_that_no_gyro_leads_holds_for_all_that_was_driven_until_it_showed() -> None:
    """The back end begins anew, and comes out where one that knew it from the start does."""
    found_out, known = BackEnd(gyro_led=False), BackEnd(gyro_led=False)
    known._begin(WHEELS_ALONE)
    lines: list[str] = []
    for increment in drive(radians(4.0), 20.0):
        correction, expected = found_out.take(increment), known.take(increment)
        lines += correction.log_lines
    assert [line for line in lines if "walls turn" in line]
    assert correction.poses == pytest.approx(expected.poses, abs=1e-9)


def walls_turn(monkeypatch: pytest.MonkeyPatch, turns_deg_per_m: list[float]) -> bool:
    """After walls seemed to turn by so much, one stretch after the other."""
    turns = iter(turns_deg_per_m)
    monkeypatch.setattr("onboard.mmu.back_end.sequential_matching.apparent_turn", lambda *_: radians(next(turns)))
    keyframes = KeyframeGraph(UNKNOWN)
    matching = SequentialMatching(keyframes)
    for i in range(len(turns_deg_per_m)):
        path_m = (i + 1) * TURN_PATH_M
        keyframes.add(Keyframe(path_m, Pose2(path_m, 0.0, 0.0), path_m, path_m, 0.0, 0.0), prior_map=False)
        matching.measure_turn()
    return matching.walls_turn


def test_walls_that_turn_this_way_and_that_leave_a_gyro_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a hall full of things each stretch seems to turn, and by chance a few one way."""
    assert not walls_turn(monkeypatch, [-0.5, 4.5, 3.9, -1.1, 5.0, 0.6, 3.1, -2.2, 4.4, 0.8])


def test_walls_that_all_turn_one_way_show_that_no_gyro_leads(monkeypatch: pytest.MonkeyPatch) -> None:
    assert walls_turn(monkeypatch, [-3.1, -2.4, -3.8, -3.0, -2.7])
