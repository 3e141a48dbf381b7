"""A person says where the robot stands: it was carried there, or it was not; and what is of no use."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from common.geometry import Pose2
from common.messages.mission import Operation, OperatorCommand, PoseAnswer
from common.messages.topics import OPERATION, POSE_ANSWER
from tests.unit.test_mmu_node import START, Bench, path, wall_distance_m, way

ELSEWHERE = Pose2(5.0, 5.1, pi)  # the other side of the island
WAY_ON = [(0.9, 5.1), (0.9, 0.9), (7.1, 0.9)]


def stated(bench: Bench, pose: Pose2, sd_m: float = 0.5, sd_rad: float = radians(15.0), command_id: int = 7) -> None:
    """By a person who knows where on the floor, in true coordinates."""
    on_map = START.between(pose)
    place = {"x_m": on_map.x_m, "y_m": on_map.y_m, "heading_rad": on_map.heading_rad}
    command = OperatorCommand(
        bench.now_s, Operation.POSE, command_id=command_id, sd_m=sd_m, sd_heading_rad=sd_rad, **place
    )
    bench.receiver.publish(OPERATION, command)


def answered(bench: Bench) -> PoseAnswer:
    bench.step()
    answer = bench.receiver.latest(POSE_ANSWER)
    assert answer is not None
    return answer


def off(bench: Bench) -> float:
    """Metres from where it is to where it believes to be."""
    return START.compose(bench.poses[-1].pose).distance_m(bench.truth[-1])


def follow(bench: Bench, goals: list[tuple[float, float]]) -> None:
    for speed_m_s, pose in way(bench.truth[-1], goals):
        bench.report(speed_m_s, pose)


def carry(bench: Bench, pose: Pose2) -> None:
    """No wheel turns, and the gyro was off."""
    bench.truth[-1] = pose
    stand(bench)


def stand(bench: Bench) -> None:
    for _ in range(3):
        bench.report(0.0, bench.truth[-1])


@pytest.fixture
def bench() -> Bench:
    """Once round the island, and it stands."""
    bench = Bench()
    for speed_m_s, pose in path(beyond_m=1.0):
        bench.report(speed_m_s, pose)
    stand(bench)
    return bench


def test_a_robot_that_was_carried_goes_on_in_its_map_from_where_a_person_says(bench: Bench) -> None:
    carry(bench, ELSEWHERE)
    assert off(bench) > 4.0
    stated(bench, ELSEWHERE.compose(Pose2(0.4, -0.3, radians(8.0))))
    answer = answered(bench)
    assert (answer.refused, answer.command_id) == (False, 7)
    assert off(bench) == pytest.approx(0.5, abs=0.1)
    assert bench.poses[-1].valid
    assert bench.poses[-1].sd_xy_m == pytest.approx(0.5, abs=0.05)
    assert bench.poses[-1].sd_heading_rad == pytest.approx(radians(15.0), abs=0.02)
    follow(bench, WAY_ON)
    assert off(bench) < 0.15, "a loop closure has found the place itself"
    assert bench.poses[-1].sd_xy_m < 0.2
    assert np.percentile(wall_distance_m(START.transform(bench.received_map())), 95) < 0.2


def test_a_robot_that_does_not_know_where_it_is_takes_what_a_person_says(bench: Bench) -> None:
    bench.truth[-1] = ELSEWHERE
    bench.left_m += 50.0  # ticks that jump: it knows that it does not know
    for _ in range(6):
        bench.report(0.0, bench.truth[-1])
    assert not bench.poses[-1].valid
    stated(bench, ELSEWHERE)
    assert not answered(bench).refused
    assert bench.poses[-1].valid
    assert off(bench) < 0.1


def test_a_pose_that_the_sonars_contradict_is_refused_and_the_better_one_kept(bench: Bench) -> None:
    """A hall is on both sides of it; in the middle of the island none is."""
    before = bench.poses[-1]
    stated(bench, Pose2(4.0, 3.0, 0.0), sd_m=0.2)
    answer = answered(bench)
    assert answer.refused
    assert "does not stand there" in answer.note
    assert (bench.poses[-1].pose, bench.poses[-1].sd_xy_m) == (before.pose, before.sd_xy_m)


def test_loop_closures_outvote_a_person_who_errs(bench: Bench) -> None:
    """One hall looks like itself a metre further on."""
    stated(bench, bench.truth[-1].compose(Pose2(-1.0, 0.0, 0.0)))
    assert not answered(bench).refused
    assert off(bench) > 0.8
    follow(bench, [(7.1, 0.9), (7.1, 5.1), (3.0, 5.1)])
    assert off(bench) < 0.2


@pytest.mark.parametrize(
    ("pose", "sd_m", "reason"),
    [
        (Pose2(30.0, 0.9, 0.0), 0.5, "within 3 m"),
        (Pose2(4.0, 0.9, 0.0), 2.0, "of no use"),
    ],
    ids=["outside the map", "too vague"],
)
def test_what_is_of_no_use_is_refused_in_one_sentence(bench: Bench, pose: Pose2, sd_m: float, reason: str) -> None:
    before = bench.poses[-1].pose
    stated(bench, pose, sd_m)
    answer = answered(bench)
    assert answer.refused
    assert reason in answer.note
    assert bench.poses[-1].pose == before


def test_a_robot_that_moves_or_has_no_map_yet_is_told_nothing() -> None:
    bench = Bench()
    bench.step()
    stated(bench, START)
    assert "Nothing is received" in answered(bench).note
    bench.report(0.0, START)
    stated(bench, START, command_id=8)
    assert "nothing is in it yet" in answered(bench).note
    bench.drive(3.0)
    stated(bench, START, command_id=9)
    assert "pause it first" in answered(bench).note


def test_a_command_that_comes_again_counts_once(bench: Bench) -> None:
    stated(bench, bench.truth[-1])
    first = answered(bench)
    follow(bench, [(5.0, 0.9)])
    stand(bench)
    stated(bench, Pose2(4.0, 0.9, 0.0))
    assert answered(bench) == first
    assert off(bench) < 0.3
