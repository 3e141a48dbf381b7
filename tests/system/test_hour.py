"""An hour of the whole mesh: memory flat, no thread and no file more than in the beginning.

On the shared clock at five times the speed; `--mission-minutes` makes it shorter. The robot maps a small floor and then
drives up and down in it until the hour is over. What grows with the floor (the map, and what is worked out from it) and
what fills up to a limit (the newest messages of every producer, the times of the newest steps, the log file) has done
so by the end of the mission and of the first quarter, which does not count; the other three are counted from there. The
table of all processes is left in `footprints.txt` of the test's folder.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest

from common.config import PoiSection, VisualizerSection, with_camera
from common.config_file import config_text
from common.messages.mission import Operation, OperatorCommand
from common.messages.topics import OPERATION, PLAN, POSE, STATUS
from deploy.local.ports import reserve_port
from deploy.local.process_table import PROCESSES
from offboard.simulator.run.options import FLOORS
from tests.system.conftest import Mesh, until
from tests.system.footprint import Footprints
from tests.system.page import frames

GROWTH_MAX_MB = 5.0
SAMPLE_PERIOD_S = 2.0
SPEED = 5.0
SHARED = ("--clock", "shared")
FLOOR = "straight"
WARM_UP = 0.25


@pytest.fixture
def whole_mesh(mesh: Mesh) -> Iterator[Mesh]:
    """With camera, recorder and a page that somebody looks at; its mission has started."""
    with tempfile.TemporaryDirectory(prefix="indoor-mapping-") as folder:
        socket = Path(folder) / "frames"
        visualizer, poi = VisualizerSection(port=reserve_port()), PoiSection(source=f"unix:{socket}")
        mesh.config = with_camera(replace(mesh.config, visualizer=visualizer, poi=poi))
        mesh.config_file.write_text(config_text(mesh.config), encoding="utf-8")
        run_dir = ("--run-dir", str(mesh.folder / "run"))
        world = ("--floor", str(FLOORS / f"{FLOOR}.json"), "--camera", "realistic", "--frames", str(socket))
        own = {"simulator": (*world, "--speed", str(SPEED)), "recorder": run_dir, "visualizer": run_dir}
        for name in ("simulator", "comm", "mmu", "planner", "poi", "recorder", "visualizer"):
            mesh.start(name, "-m", PROCESSES[name], extra=(*SHARED, *own.get(name, ())))
        until((mesh.folder / "serial").exists, 60.0, "the serial port")
        mesh.start("bridge", "-m", PROCESSES["bridge"], extra=SHARED)
        until(lambda: mesh.granted, 90.0, "the permit")
        mesh.bus.latest(PLAN)

        def started() -> bool:
            mesh.bus.publish(OPERATION, OperatorCommand(time.monotonic(), Operation.START))
            view = mesh.bus.latest(PLAN)
            return view is not None and view.mode != "WAITING"

        until(started, 30.0, "the start")
        yield mesh


def look_at_page(mesh: Mesh) -> None:
    for _ in frames(mesh.config.visualizer.host, mesh.config.visualizer.port):
        pass


class Patrol:
    """Once the mission is finished: drives the robot to where it was farthest from its start, and back, and again."""

    def __init__(self, mesh: Mesh) -> None:
        self.legs = 0
        self._bus = mesh.bus
        self._start = self._end = (0.0, 0.0)
        self.look()

    def look(self) -> None:
        pose, view = self._bus.latest(POSE), self._bus.latest(PLAN)
        if pose is not None and hypot(pose.x_m, pose.y_m) > hypot(*self._end):
            self._end = (pose.x_m, pose.y_m)
        if view is not None and view.mode == "DONE":
            self.legs += 1
            x_m, y_m = self._end if self.legs % 2 else self._start
            self._bus.publish(OPERATION, OperatorCommand(view.t_s, Operation.GOTO, x_m, y_m))


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_an_hour_of_the_whole_mesh_leaves_memory_threads_and_files_as_they_were(
    whole_mesh: Mesh, pytestconfig: pytest.Config, tmp_path: Path
) -> None:
    mission_s = 60.0 * pytestconfig.getoption("mission_minutes")
    threading.Thread(target=look_at_page, args=(whole_mesh,), daemon=True).start()
    bus = whole_mesh.bus

    def simulated_s() -> float:
        status = bus.latest(STATUS["mmu"])
        return status.t_s if status is not None else 0.0

    pids = {name: process.pid for name, process in whole_mesh.processes.items()}
    footprints, patrol, began_s = Footprints(), Patrol(whole_mesh), simulated_s()
    legs_before, until_s = 0, mission_s
    while (passed_s := simulated_s() - began_s) < until_s:
        patrol.look()
        if legs_before:
            footprints.sample(pids)
        elif passed_s > WARM_UP * mission_s and patrol.legs:
            legs_before, until_s = patrol.legs, passed_s + (1 - WARM_UP) * mission_s
        next_s = time.monotonic() + SAMPLE_PERIOD_S
        until(lambda next_s=next_s: time.monotonic() > next_s, 2 * SAMPLE_PERIOD_S)
        ended = [name for name, process in whole_mesh.processes.items() if process.poll() is not None]
        assert ended == []
    assert legs_before, "the floor was not mapped in time"
    assert patrol.legs > legs_before, "the robot did not drive on"
    growths = footprints.growths()
    table = "\n".join(map(str, growths))
    (tmp_path / "footprints.txt").write_text(table + "\n", encoding="utf-8")
    assert {growth.name for growth in growths} >= set(pids)
    assert [g.name for g in growths if g.own_mb > GROWTH_MAX_MB] == [], table
    assert [g.name for g in growths if g.late.threads > g.early.threads] == [], table
    assert [g.name for g in growths if g.late.files > g.early.files] == [], table
