"""A battery that dies in the middle of the mission: the robot is home before that."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import hypot
from pathlib import Path

import pytest

from common.constants import BATTERY_LOW_V
from common.messages.mission import Operation, Outcome
from offboard.simulator.run.options import floor_path
from tests.mission.story import Story

Tell = Callable[..., Story]


def dying(folder: Path, empty_s: float) -> Path:
    events = folder / "events.json"
    events.write_text(json.dumps({"battery": {"empty_s": empty_s}}), encoding="utf-8")
    return events


@pytest.mark.timeout(300)
@pytest.mark.requirement("PLN_MR_01")
def test_a_dying_battery_sends_the_robot_home_before_it_is_empty(island: Path, tell: Tell, tmp_path: Path) -> None:
    story = tell(island, seed=1, events=dying(tmp_path, 230.0))
    began = story.world.truth
    story.start()
    assert story.until(story.ended, 230.0)
    assert story.view().outcome is Outcome.LOW_BATTERY
    assert "battery" in story.view().detail
    assert story.carrier().battery_v > BATTERY_LOW_V
    truth = story.world.truth
    assert hypot(truth.x_m - began.x_m, truth.y_m - began.y_m) < 0.5
    furthest_m = max(hypot(x - began.x_m, y - began.y_m) for _, x, y, _ in story.world.truth_log)
    assert furthest_m > 2.0, "it had set out"
    story.say(Operation.START)
    assert story.until(lambda: story.view().outcome is Outcome.LOW_BATTERY and story.view().mode == "DONE", 30.0)


def test_an_empty_battery_ends_everything_on_the_board(hall: Path, tell: Tell, tmp_path: Path) -> None:
    story = tell(hall, seed=1, events=dying(tmp_path, 25.0))
    story.start()
    story.run(26.0 - story.now_s)
    stopped = story.world.truth
    story.run(5.0)
    assert story.world.truth.distance_m(stopped) < 0.05
    assert not story.granted()


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("floor", ["straight", "loop"])
def test_a_dying_battery_sends_the_robot_home_on_the_project_s_own_floors(
    floor: str, tell: Tell, tmp_path: Path
) -> None:
    """Some minutes on two cores."""
    empty_s = 420.0
    story = tell(floor_path(floor), seed=1, events=dying(tmp_path, empty_s))
    began = story.world.truth
    story.start()
    assert story.until(story.ended, empty_s)
    assert story.view().outcome is Outcome.LOW_BATTERY
    assert story.carrier().battery_v > BATTERY_LOW_V
    truth = story.world.truth
    print(f"{floor}: home after {story.now_s:.0f} s of {empty_s:.0f} s, {story.carrier().battery_v:.2f} V")
    assert hypot(truth.x_m - began.x_m, truth.y_m - began.y_m) < 0.5
