"""Stories of the whole robot on small floors, in simulated time."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import cos, degrees, hypot, inf, radians, sin
from pathlib import Path
from typing import Any

import pytest

from common.constants import FOOTPRINT_RADIUS_M, REVERSE_MAX_M
from common.errors import StartError
from common.geometry import wrap_angle
from common.messages.mission import Operation
from common.messages.points_of_interest import PoiCommand, PoiRequest
from common.messages.stop import StopRequest
from common.messages.topics import DRIVE, GRID, MAP, PERMIT, POSE, RETAKE, STOP, TRAJECTORY
from offboard.simulator.run.lockstep import simulate
from offboard.simulator.run.options import RunOptions
from offboard.simulator.run.side_workers import apart
from tests.mission.story import Story

Tell = Callable[..., Story]

STANDS_WITHIN_S = 0.6
PERSON_RADIUS_M = 0.25


def mapped_and_came_home(options: RunOptions) -> dict[str, Any]:
    """Runs the mission and asserts what every one must reach; returns its summary."""
    assert options.out is not None
    try:
        code = simulate(options)
    except StartError as error:
        pytest.skip(str(error))
    summary: dict[str, Any] = json.loads((options.out / "summary.json").read_text(encoding="utf-8"))
    assert code == 0, summary["reason"]
    assert summary["finished"]
    assert summary["coverage"] > 0.85
    assert summary["clearance_m"] > 0.0
    assert summary["home_m"] < 0.5
    assert summary["map_rmse_m"] < 0.3
    return summary


@pytest.mark.timeout(300)
@pytest.mark.requirement("PLN_MR_01", "PLN_MR_03", "MMU_MR_02", "MMU_MR_03", "MMU_SR_04", "SIM_MR_02")
def test_robot_maps_a_floor_with_an_island_and_comes_home(island: Path, tmp_path: Path) -> None:
    summary = mapped_and_came_home(RunOptions(island, seed=1, out=tmp_path / "run"))
    assert summary["ate_fit_m"] < 0.3


def messages_of(story: Story, seconds: float) -> dict[str, list[Any]]:
    """What the modules say, in a form that can be compared."""
    operator = story.robot.operator
    for topic in (POSE, DRIVE, MAP, GRID, TRAJECTORY):
        operator.take(topic)
    said: dict[str, list[Any]] = {"pose": [], "drive": [], "map": [], "grid": [], "trajectory": []}

    def listen() -> None:
        said["pose"] += operator.take(POSE)
        said["drive"] += operator.take(DRIVE)
        said["map"] += [(m.t_s, m.revision, m.start, m.points_m.tobytes()) for m in operator.take(MAP)]
        said["grid"] += [(g.t_s, g.revision, g.cells_zlib) for g in operator.take(GRID)]
        said["trajectory"] += [(t.t_s, t.poses.tobytes()) for t in operator.take(TRAJECTORY)]

    story.start()
    story.run(seconds, listen)
    return said


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_binary_for_the_mega_maps_a_whole_floor(island: Path, tmp_path: Path) -> None:
    mapped_and_came_home(RunOptions(island, seed=1, out=tmp_path / "run", board="avr"))


def test_a_run_repeats_to_the_bit_from_its_seed_and_another_seed_is_another_run(hall: Path, tell: Tell) -> None:
    first, again, other = (messages_of(tell(hall, seed=seed), 60.0) for seed in (5, 5, 6))
    assert all(first.values())
    assert first == again
    assert first["pose"] != other["pose"]


def test_a_run_is_the_same_with_the_work_beside_the_nodes_on_another_core(hall: Path, tell: Tell) -> None:
    assert messages_of(tell(hall, seed=5, beside=apart), 60.0) == messages_of(tell(hall, seed=5), 60.0)


@pytest.mark.requirement("PLN_MR_03")
def test_robot_stops_in_front_of_a_person_and_goes_on_when_they_are_gone(
    hall: Path, tell: Tell, tmp_path: Path
) -> None:
    # Where it drives, told by the same run without a person
    alone = tell(hall, seed=3)
    alone.start()
    assert alone.until(lambda: alone.world.truth.x_m > 3.0 and alone.drives(), 300.0)
    comes_s, pose = alone.now_s, alone.world.truth
    at = (pose.x_m + 0.9 * cos(pose.heading_rad), pose.y_m + 0.9 * sin(pose.heading_rad))
    events = tmp_path / "events.json"
    person = {"from_s": comes_s, "to_s": comes_s + 12.0, "speed_m_s": 1.0, "radius_m": PERSON_RADIUS_M}
    events.write_text(json.dumps({"people": [person | {"waypoints": [at]}]}), encoding="utf-8")

    story = tell(hall, seed=3, events=events)
    world = story.world
    nearest_m = inf

    def keep_watch() -> None:
        nonlocal nearest_m
        for x_m, y_m, radius_m in world.people:
            away_m = hypot(world.truth.x_m - x_m, world.truth.y_m - y_m)
            nearest_m = min(nearest_m, away_m - radius_m - FOOTPRINT_RADIUS_M)

    story.start()
    story.run(comes_s - story.now_s + 0.5, keep_watch)
    assert world.people, "the person is there"
    assert story.drives()
    story.run(4.0, keep_watch)
    assert abs(story.carrier().speed_m_s) < 0.1
    story.run(8.0, keep_watch)
    assert not world.people
    assert nearest_m > 0.0
    assert world.contacts == 0
    assert world.clearance_m > 0.0
    assert story.goes_on()


@pytest.mark.requirement("CC_MR_04")
def test_an_operator_s_stop_holds_until_released_and_resumed(hall: Path, tell: Tell) -> None:
    story = tell(hall, seed=2)
    operator = story.robot.operator
    story.start()
    assert story.until(story.drives, 120.0)

    operator.publish(STOP, StopRequest(story.now_s, "operator", latched=True, stop_id=7))
    assert story.until(story.wheels_stand, STANDS_WITHIN_S)
    story.run(1.0)
    stopped = story.world.truth

    def assert_stands() -> None:
        truth = story.world.truth
        assert truth.distance_m(stopped) < 0.02
        assert abs(degrees(wrap_angle(truth.heading_rad - stopped.heading_rad))) < 2.0

    story.run(3.0, assert_stands)
    assert not story.granted()
    assert story.carrier().stop_latched

    permit = operator.latest(PERMIT)
    assert permit is not None
    operator.publish(STOP, StopRequest(story.now_s, "operator", latched=False, epoch=permit.stop_epoch))
    story.run(5.0, assert_stands)
    story.say(Operation.START)
    story.run(2.0, assert_stands)
    assert not story.granted()

    story.say(Operation.RESUME)
    assert story.goes_on()


@pytest.mark.requirement("POI_MR_05", "CAR_MR_04")
def test_requests_to_go_on_and_back_by_turns_never_lead_further_back_than_half_a_metre(hall: Path, tell: Tell) -> None:
    story = tell(hall, seed=2)
    poi = story.robot.mesh.endpoint("poi")
    story.start()
    assert story.until(lambda: story.world.truth.x_m > 2.0 and story.drives(), 120.0)
    furthest_m = backmost_m = story.world.truth.x_m

    def keep_watch() -> None:
        nonlocal furthest_m, backmost_m
        furthest_m = max(furthest_m, story.world.truth.x_m)
        backmost_m = min(backmost_m, story.world.truth.x_m)

    for _ in range(6):
        for command, seconds in ((PoiCommand.REVERSE, 3.0), (PoiCommand.CONTINUE, 0.1)):
            poi.publish(RETAKE, PoiRequest(story.now_s, command))
            story.run(seconds, keep_watch)
    assert 0.3 < furthest_m - backmost_m < REVERSE_MAX_M
    assert story.world.contacts == 0
    assert story.goes_on()


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("module", ["mmu", "planner", "comm", "bridge"])
def test_robot_stops_when_a_module_falls_silent(hall: Path, tell: Tell, module: str) -> None:
    story = tell(hall, seed=2)
    story.start()
    assert story.until(story.drives, 120.0)
    slot = next(s for s in story.robot.slots if s.node.name == module)
    slot.frozen = True
    assert story.until(story.wheels_stand, 1.5)
    story.run(1.0)
    stopped = story.world.truth
    story.run(3.0)
    assert story.world.truth.distance_m(stopped) < 0.02
    slot.frozen = False
    assert story.goes_on()


def test_pause_holds_the_robot_and_resume_lets_it_go_on(hall: Path, tell: Tell) -> None:
    story = tell(hall, seed=2)
    story.start()
    assert story.until(story.drives, 120.0)
    story.say(Operation.PAUSE)
    assert story.until(story.wheels_stand, 1.5)
    story.run(1.0)
    stopped = story.world.truth
    story.run(5.0)
    assert story.world.truth.distance_m(stopped) < 0.02
    story.say(Operation.RESUME)
    assert story.goes_on()


@pytest.mark.requirement("MMU_MR_02")
def test_pose_follows_a_turn_by_hand_while_the_wheels_stand(hall: Path, tell: Tell, tmp_path: Path) -> None:
    events = tmp_path / "events.json"
    events.write_text(json.dumps({"turned": [{"from_s": 15.0, "to_s": 17.0, "angle_deg": 40}]}), encoding="utf-8")
    story = tell(hall, seed=4, events=events)
    story.run(12.0)
    # Else the wheels would steer against it
    story.robot.operator.publish(STOP, StopRequest(story.now_s, "command_center", latched=True, stop_id=7))
    story.run(2.5)
    before, began = story.robot.operator.latest(POSE), story.world.truth
    story.run(4.0)
    after, ended = story.robot.operator.latest(POSE), story.world.truth
    assert before is not None
    assert after is not None
    assert wrap_angle(ended.heading_rad - began.heading_rad) == pytest.approx(radians(40.0), abs=radians(1.0))
    turned_rad = wrap_angle(after.heading_rad - before.heading_rad)
    assert turned_rad == pytest.approx(radians(40.0), abs=radians(3.0))
    assert hypot(after.x_m - before.x_m, after.y_m - before.y_m) < 0.05
