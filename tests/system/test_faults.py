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
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from common.clock import FreeClock
from common.config import load_config
from common.messages import PERMIT, PLAN
from common.zenoh_bus import ZenohBus
from tests.system.conftest import ROOT, children_of, environment, run_cli, until

pytestmark = pytest.mark.timeout(90)
STOPPED_WITHIN_S = 0.5
STANDS_FOR_S = 1.5


class Motors(NamedTuple):
    """A line of the simulator's motor log, on the monotonic clock."""

    t_s: float
    pwm_left: int
    pwm_right: int
    enabled: bool

    @property
    def driving(self) -> bool:
        return self.pwm_left != 0 and self.pwm_right != 0 and self.enabled

    @property
    def dead(self) -> bool:
        return (self.pwm_left, self.pwm_right, self.enabled) == (0, 0, False)


class Running:
    """A headless `local` whose mission has started."""

    def __init__(self, folder: Path) -> None:
        self.run_dir = folder / "run"
        self.config_file = self.run_dir / "process" / "robot.toml"
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

    def motors(self) -> list[Motors]:
        lines = (self.run_dir / "process" / "motors.csv").read_text(encoding="utf-8").splitlines()[1:]
        rows = [line.split(",") for line in lines]
        return [Motors(float(t), int(left), int(right), enabled == "1") for t, left, right, enabled in rows]

    def await_driving(self, after_s: float = 0.0) -> None:
        def driving() -> bool:
            newest = self.motors()[-1:]
            return bool(newest) and newest[0].driving and newest[0].t_s > after_s

        until(driving, 30.0, "driving")

    def dead_after_s(self, hit_s: float) -> float:
        """Waits for PWM 0 with the driver's enable low; how long after `hit_s` it came."""
        until(lambda: any(m.dead and m.t_s > hit_s for m in self.motors()), 5.0, "the end of all motion")
        return next(m.t_s for m in self.motors() if m.dead and m.t_s > hit_s) - hit_s

    def stands(self) -> bool:
        """The motors do not turn, and do not for a while; that their driver is switched on is no motion."""
        since_s = time.monotonic()
        until(lambda: time.monotonic() > since_s + STANDS_FOR_S)
        motors = self.motors()
        count = 1 + sum(m.t_s > since_s for m in motors)
        return all((m.pwm_left, m.pwm_right) == (0, 0) for m in motors[-count:])

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


@pytest.mark.requirement("CM_MR_02", "CAR_MR_02")
@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL], ids=["frozen", "killed"])
@pytest.mark.parametrize("victim", ["bridge", "comm", "planner", "mmu"])
def test_motors_are_off_half_a_second_after_a_fault_and_the_mission_goes_on(
    mesh: Running, victim: str, number: signal.Signals
) -> None:
    mesh.await_driving()
    pid = children_of(mesh.run_dir)[victim]
    hit_s = time.monotonic()
    os.kill(pid, number)
    dead_after_s = mesh.dead_after_s(hit_s)
    if number is signal.SIGSTOP:
        os.kill(pid, signal.SIGCONT)
    assert dead_after_s < STOPPED_WITHIN_S
    mesh.await_driving(hit_s + dead_after_s)
    assert mesh.process.poll() is None, mesh.output


@pytest.mark.requirement("CC_MR_04")
def test_estop_latches_and_only_a_resume_moves_the_robot_again(mesh: Running) -> None:
    mesh.await_driving()
    asked_s = time.monotonic()
    mesh.command("estop")
    mesh.dead_after_s(asked_s)
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.stop_sources == ("operator",))
    assert mesh.stands()
    mesh.command("resume")
    mesh.command("release")
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.granted, what="the permit")
    assert mesh.stands()
    resumed_s = time.monotonic()
    mesh.command("resume")
    mesh.await_driving(resumed_s)


def test_a_planner_that_is_restarted_during_a_stop_waits_for_a_start(mesh: Running) -> None:
    mesh.await_driving()
    mesh.command("estop")
    planner = children_of(mesh.run_dir)["planner"]
    os.kill(planner, signal.SIGKILL)
    until(lambda: children_of(mesh.run_dir).get("planner", planner) != planner, 10.0, "the restart")
    mesh.command("release")
    until(lambda: (permit := mesh.bus.latest(PERMIT)) is not None and permit.granted, 20.0, "the permit")
    assert mesh.stands()
    until(lambda: (view := mesh.bus.latest(PLAN)) is not None and view.mode == "WAITING", what="the planner's view")
    started_s = time.monotonic()
    mesh.command("start")
    mesh.await_driving(started_s)
