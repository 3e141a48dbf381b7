"""A floor mapped by deployed programs on two boards, with the cable pulled on the way. Ten minutes."""

from __future__ import annotations

import json
import sqlite3
import time
from pathlib import Path

import numpy as np
import pytest

from common.messages.mission import Outcome
from offboard.evaluate.figures import evaluate
from offboard.operate.software_stop import Look
from offboard.runs.run_database import RunReader
from tests.system.conftest import until
from tests.system.deployed_robot import FLOOR, DeployedRobot, deployed_robot
from tests.system.motors import STOPPED_WITHIN_S
from tests.system.page import page_map
from tests.system.recording import recorded_map

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]
MISSION_S = 600.0
AWAY_S = 5.0  # much longer than a permit counts, or a lease


def pull_and_plug(robot: DeployedRobot) -> None:
    """The cable of the BeagleBone, while it drives; the robot stands as long as it is out."""
    robot.motors.await_driving()
    pulled_s = time.monotonic()
    robot.beaglebone.link.up = False
    stopped_s = robot.motors.dead_after_s(pulled_s)
    print(f"the wheels stood {stopped_s:.3f} s after the cable was pulled")
    assert stopped_s < STOPPED_WITHIN_S
    until(lambda: time.monotonic() > pulled_s + AWAY_S, 2 * AWAY_S)
    assert not robot.motors.turned(pulled_s + stopped_s, time.monotonic())
    assert robot.center.node.snapshot().look is Look.LINK_LOST


def drove(robot: DeployedRobot, distance_m: float) -> bool:
    pose = robot.center.node.snapshot().pose
    return pose is not None and pose.x_m > distance_m


def assert_no_hole(run_dir: Path) -> None:
    """Every message of every module is in the database once, in its order, from its first one on."""
    with RunReader(run_dir) as run:
        assert run.dropped() == {}
        assert run.problems() == {}
        assert {source: found for source, found in run.senders().items() if found[0] != found[1]} == {}
    with sqlite3.connect(run_dir / "run.sqlite") as database:
        newest: dict[tuple[str, int], int] = {}
        for topic, boot_id, sequence in database.execute("SELECT topic, boot_id, sequence FROM messages ORDER BY row"):
            assert sequence == newest.get((topic, boot_id), 0) + 1, (topic, boot_id)
            newest[topic, boot_id] = sequence
        print(f"{sum(newest.values())} messages of {len(newest)} topics and lives")


def test_deployed_programs_map_a_floor_to_the_end_though_the_cable_is_pulled_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with deployed_robot(tmp_path, monkeypatch) as robot:
        robot.deploy("bootstrap")
        assert "Nothing stands in the way on raspberry and beaglebone." in robot.deploy("check")
        print(robot.deploy("push"))
        robot.start_laptop()
        # A robot that was switched on waits for a person
        until(lambda: robot.center.node.snapshot().look is Look.LATCHED, 60.0, "a robot that waits")
        robot.drive()
        began_s = time.monotonic()

        until(lambda: drove(robot, 2.0), 120.0, "two metres")
        pull_and_plug(robot)
        robot.beaglebone.link.up = True
        plugged_s = time.monotonic()
        robot.motors.await_driving(plugged_s)  # nobody stopped it, so it demands nobody
        print(f"it drove {time.monotonic() - plugged_s:.1f} s after the cable was plugged in")

        until(lambda: drove(robot, 3.0), 120.0, "three metres")
        pull_and_plug(robot)
        robot.center.node.stop_desk.press()
        robot.beaglebone.link.up = True
        until(lambda: robot.center.node.stop_desk.control.latency_s is not None, 20.0, "the stop from meanwhile")
        assert robot.motors.stands()
        robot.go_on()

        until(lambda: robot.view.outcome.ends_mission, MISSION_S, "the end of the mission")
        assert robot.view.outcome is Outcome.FINISHED, robot.view.detail
        print(f"{robot.view.detail}, {time.monotonic() - began_s:.0f} s after the start")
        until(lambda: robot.state_of("recorder") == "finished", 60.0, "the end of the mission in the database")
        recorded = recorded_map(robot.run_dir)
        shown = page_map(robot.config.visualizer.host, robot.config.visualizer.port, len(recorded))
        assert np.array_equal(shown, recorded)
        robot.deploy("stop")
        for name in ("recorder", "simulator"):
            robot.end(name)
    assert_no_hole(robot.run_dir)
    figures = evaluate(json.loads(FLOOR.read_text(encoding="utf-8")), robot.run_dir)
    print({name: figures[name] for name in ("coverage", "map_rmse_m", "ate_fit_m", "home_m", "doors", "numbers_exact")})
    assert figures["coverage"] > 0.85
    assert figures["map_rmse_m"] < 0.06
    assert figures["home_m"] < 0.3
    with RunReader(robot.run_dir) as run:
        assert {poi.number for poi in run.pois()} == {"101", "102"}
