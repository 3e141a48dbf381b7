"""The whole mesh in the middle of a mission: what fails stops the motors, seen at the body itself, within 0.5 s.

Real time and free-running clock. One mesh serves all faults, one after the other: that it drives again by itself after
each of them is half of what is shown.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from common.clock import FreeClock
from common.config import load_config
from common.messages import PERMIT, PLAN
from common.zenoh_bus import ZenohBus
from offboard.simulator.process import MOTORS_NAME
from tests.system.conftest import ROOT, children_of, environment, run_cli, until
from tests.system.main_thread import hold_main_thread, let_go
from tests.system.motors import STOPPED_WITHIN_S, MotorLog

pytestmark = pytest.mark.timeout(90)


class Running:
    """A headless `local` whose mission has started."""

    def __init__(self, folder: Path) -> None:
        self.run_dir = folder / "run"
        self.config_file = self.run_dir / "process" / "robot.toml"
        self.motors = MotorLog(self.run_dir / "process" / MOTORS_NAME)
        self._output = folder / "output.txt"
        with self._output.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "deploy.cli", "local", "--floor", "loop", "--headless", "--out", self.run_dir],
                env=environment(),
                cwd=ROOT,
                stdout=output,
                stderr=output,
            )
        until(lambda: "mission has started" in self.output or self.process.poll() is not None, 40.0, "the start")
        assert self.process.poll() is None, self.output
        self.bus = ZenohBus("watcher", load_config(self.config_file), FreeClock())

    @property
    def output(self) -> str:
        return self._output.read_text(encoding="utf-8")

    def command(self, verb: str) -> None:
        result = run_cli(verb, "--config", str(self.config_file))
        assert result.returncode == 0, result.stderr

    def close(self) -> None:
        self.bus.close()
        self.process.terminate()
        self.process.wait(45.0)


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running = Running(tmp_path_factory.mktemp("faults"))
    yield running
    running.close()


def freeze(pid: int) -> None:
    os.kill(pid, signal.SIGSTOP)


def thaw(pid: int) -> None:
    os.kill(pid, signal.SIGCONT)


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def leave_it(pid: int) -> None:
    """Its supervisor restarts it."""


@pytest.mark.requirement("CM_MR_02", "CAR_MR_02")
@pytest.mark.parametrize(
    ("hit", "undo"),
    [(freeze, thaw), (kill, leave_it), (hold_main_thread, let_go)],
    ids=["frozen", "killed", "main loop stuck"],
)
@pytest.mark.parametrize("victim", ["bridge", "comm", "planner", "mmu"])
def test_motors_are_off_half_a_second_after_a_fault_and_the_mission_goes_on(
    mesh: Running, victim: str, hit: Callable[[int], None], undo: Callable[[int], None]
) -> None:
    mesh.motors.await_driving()
    pid = children_of(mesh.run_dir)[victim]
    hit_s = time.monotonic()
    hit(pid)
    try:
        dead_after_s = mesh.motors.dead_after_s(hit_s)
        if hit is hold_main_thread:
            assert victim in mesh.bus.alive_tokens()
    finally:
        undo(pid)
    assert dead_after_s < STOPPED_WITHIN_S
    mesh.motors.await_driving(hit_s + dead_after_s)
    assert mesh.process.poll() is None, mesh.output


@pytest.mark.requirement("CC_MR_04")
def test_estop_latches_and_only_a_resume_moves_the_robot_again(mesh: Running) -> None:
    mesh.motors.await_driving()
    asked_s = time.monotonic()
    mesh.command("estop")
    mesh.motors.dead_after_s(asked_s)
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.stop_sources == ("operator",))
    assert mesh.motors.stands()
    mesh.command("resume")
    mesh.command("release")
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.granted, what="the permit")
    assert mesh.motors.stands()
    resumed_s = time.monotonic()
    mesh.command("resume")
    mesh.motors.await_driving(resumed_s)


def test_a_planner_that_is_restarted_during_a_stop_waits_for_a_start(mesh: Running) -> None:
    mesh.motors.await_driving()
    mesh.command("estop")
    planner = children_of(mesh.run_dir)["planner"]
    os.kill(planner, signal.SIGKILL)
    until(lambda: children_of(mesh.run_dir).get("planner", planner) != planner, 10.0, "the restart")
    mesh.command("release")
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.granted, 20.0, "the permit")
    assert mesh.motors.stands()
    until(lambda: (view := mesh.bus.latest(PLAN)) is not None and view.mode == "WAITING", what="the planner's view")
    started_s = time.monotonic()
    mesh.command("start")
    mesh.motors.await_driving(started_s)
