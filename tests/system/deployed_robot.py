"""A robot of two boards that `deploy` has put its programs on, around the simulated body with its real firmware.

Boards and laptop hang on one switch and meet over TLS. Building and body are processes of this machine, whose serial
line and camera the boards find as devices.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from common.config import BoardSection, BridgeSection, Config, MeshSection, PoiSection, VisualizerSection, with_camera
from common.config_file import config_text
from common.messages.mission import PlannerView
from deploy.local.ports import reserve_port
from deploy.local.process_table import PROCESSES
from offboard.simulator.run.process import MOTORS_NAME
from tests.system.board_machine import BoardMachine, board_machines
from tests.system.center import Center
from tests.system.conftest import ROOT, environment, free_endpoint, until
from tests.system.motors import MotorLog
from tests.system.operating import Operator
from tests.system.switch import open_switch

FLOOR = Path(__file__).parent / "floors" / "short.json"
BOARDS = ("board-a", "board-b")
_DEPLOY_S = 600.0
_END_S = 20.0


class DeployedRobot(Operator):
    """`beaglebone` and `raspberry` are its boards; nothing is on them yet."""

    def __init__(self, folder: Path, beaglebone: BoardMachine, raspberry: BoardMachine, devices: Path) -> None:
        self.folder, self.beaglebone, self.raspberry = folder, beaglebone, raspberry
        platform = os.uname().machine
        self.config = with_camera(
            Config(
                mesh=MeshSection(
                    laptop_router=free_endpoint(),
                    listen="tls/0.0.0.0:7449",
                    robot=f"tls/{beaglebone.link.there}:7449",
                    keys=str(folder / "keys"),
                ),
                beaglebone=BoardSection(("bridge", "comm+mmu+planner"), ssh=beaglebone.name, platform=platform),
                raspberry=BoardSection(("poi",), ssh=raspberry.name, platform=platform),
                bridge=BridgeSection(serial_port=str(devices / "serial")),
                poi=PoiSection(source=f"unix:{devices / 'frames'}"),
                visualizer=VisualizerSection(port=reserve_port()),
            )
        )
        self.config_file = folder / "robot.toml"
        self.config_file.write_text(config_text(self.config), encoding="utf-8")
        self.run_dir, self._logs = folder / "run", folder / "process"
        for made in (self.run_dir, self._logs):
            made.mkdir()
        self.motors = MotorLog(self._logs / MOTORS_NAME)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._start("simulator", "--floor", str(FLOOR), "--camera", "realistic", "--frames", str(devices / "frames"))
        until((devices / "serial").exists, 60.0, "the serial port")

    def deploy(self, *words: str, fails: bool = False, root: Path = ROOT) -> str:
        """`indoor-mapping deploy` of the sources in `root`; both of its outputs."""
        command = [sys.executable, "-m", "deploy.cli", "deploy", *words, "--config", str(self.config_file)]
        own = environment() | {"PYTHONPATH": str(root)}
        done = subprocess.run(
            command, cwd=root, env=own, capture_output=True, text=True, timeout=_DEPLOY_S, check=False
        )  # fmt: skip
        said = done.stdout + done.stderr
        assert (done.returncode != 0) == fails, said
        return said

    def start_laptop(self) -> None:
        """Recorder, page and command center, once there are keys."""
        self._start("recorder")
        self._start("visualizer")
        self.center = Center(self.config)

    def _start(self, name: str, *arguments: str) -> None:
        common = ("--config", str(self.config_file), "--log-dir", str(self._logs))
        own = () if name == "command_center" else ("--run-dir", str(self.run_dir))
        with (self._logs / f"{name}.output").open("wb") as output:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", PROCESSES[name], *common, *own, *arguments],
                env=environment(), cwd=ROOT, stdout=output, stderr=output, start_new_session=True,
            )  # fmt: skip

    def end(self, name: str) -> None:
        """A process of this machine, in order."""
        self._processes[name].terminate()
        assert self._processes[name].wait(_END_S) == 0, (self._logs / f"{name}.output").read_text()

    @property
    def view(self) -> PlannerView:
        """The mission, as the command center knows it."""
        view = self.center.node.snapshot().view
        assert view is not None, "the planner never came"
        return view

    def state_of(self, module: str) -> str:
        """As its newest status has it; empty where none came."""
        rows = self.center.node.snapshot().rows
        return next((row.status.state for row in rows if row.module == module and row.status is not None), "")

    @property
    def permit_reason(self) -> str:
        """Why the robot may not move; empty where it may."""
        permit = self.center.node.snapshot().permit
        return "no permit came" if permit is None else permit.reason

    def stands_whatever_is_asked(self, for_s: float) -> bool:
        """A person does all that there is to make it drive, and the motors stay off meanwhile."""
        since_s = time.monotonic()

        def over() -> bool:
            self.ask_for_motion()
            return time.monotonic() > since_s + for_s

        until(over, for_s + 5.0)
        return not self.motors.turned(since_s, time.monotonic())

    def close(self) -> None:
        with suppress(AttributeError):
            self.center.close()
        for process in self._processes.values():
            process.kill()
            process.wait()


@contextmanager
def deployed_robot(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[DeployedRobot]:
    """Bare boards, and the body; skips the test where there can be none."""
    switch = open_switch()
    try:
        # Below /dev, which a board shares with this machine
        with (
            tempfile.TemporaryDirectory(prefix="indoor-mapping-", dir="/dev") as devices,
            board_machines(folder, monkeypatch, *BOARDS, open_link=switch.plug) as (beaglebone, raspberry),
        ):
            robot = DeployedRobot(folder, beaglebone, raspberry, Path(devices))
            try:
                yield robot
            finally:
                robot.close()
    finally:
        switch.close()
