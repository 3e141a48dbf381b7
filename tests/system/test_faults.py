"""The whole mesh in the middle of a mission: what fails stops the motors, seen at the body itself, within 0.5 s.

Real time and free-running clock. One mesh serves all faults, one after the other: that it drives again by itself after
each of them is half of what is shown.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from common.clock import FreeClock
from common.config_file import load_config
from common.messages.health import Status
from common.messages.stop import Permit
from common.messages.topics import LAPTOP_RECORDED, PERMIT, PLAN, ROBOT_RECORDED, TOPICS, Topic
from common.zenoh_bus import ZenohBus
from offboard.simulator.run.process import MOTORS_NAME
from tests.system.cable import Cable
from tests.system.center import Center
from tests.system.conftest import ROOT, children_of, environment, run_cli, until
from tests.system.junk import huge, junk, throw
from tests.system.main_thread import hold_main_thread, let_go
from tests.system.motors import STOPPED_WITHIN_S, MotorLog
from tests.system.recording import RobotMap

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
                [
                    sys.executable,
                    "-m",
                    "deploy.cli",
                    "local",
                    "--floor",
                    "loop",
                    "--headless",
                    "--apart",
                    "--out",
                    self.run_dir,
                ],
                env=environment(),
                cwd=ROOT,
                stdout=output,
                stderr=output,
            )
        until(lambda: "mission has started" in self.output or self.process.poll() is not None, 40.0, "the start")
        assert self.process.poll() is None, self.output
        self.config = load_config(self.config_file)
        self.bus = ZenohBus("watcher", self.config, FreeClock())
        self.center = Center(self.config)

    @property
    def output(self) -> str:
        return self._output.read_text(encoding="utf-8")

    def command(self, verb: str) -> None:
        result = run_cli(verb, "--config", str(self.config_file))
        assert result.returncode == 0, result.stderr

    def refused(self, verb: str) -> str:
        """Why the robot does not take it."""
        result = run_cli(verb, "--config", str(self.config_file))
        assert result.returncode == 1, result.stdout
        return result.stderr

    @property
    def permit(self) -> Permit:
        until(lambda: self.bus.latest(PERMIT) is not None, what="a permit")
        permit = self.bus.latest(PERMIT)
        assert permit is not None
        return permit

    def names(self, victim: str) -> bool:
        """The command center says who stops the robot: comm does, and of comm itself that it is not heard."""
        permit = self.center.node.snapshot().permit
        reason = permit.reason if permit is not None else ""
        return victim in reason or (victim == "comm" and victim not in self.center.live())

    def close(self) -> None:
        self.center.close()
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
        until(lambda: mesh.names(victim), what="the reason in the command center")
    finally:
        undo(pid)
    assert dead_after_s < STOPPED_WITHIN_S
    mesh.motors.await_driving(hit_s + dead_after_s)
    assert mesh.process.poll() is None, mesh.output


@pytest.fixture(scope="module")
def cable(mesh: Running) -> Iterator[Cable]:
    """The bridge is on it."""
    laid = Cable(Path(mesh.config.bridge.serial_port))
    kill(children_of(mesh.run_dir)["bridge"])
    killed_s = time.monotonic()
    mesh.motors.await_driving(killed_s + mesh.motors.dead_after_s(killed_s))
    yield laid
    laid.close()


@pytest.mark.requirement("CAR_MR_02")
def test_motors_are_off_half_a_second_after_the_serial_line_is_cut_and_the_mission_goes_on(
    mesh: Running, cable: Cable
) -> None:
    mesh.motors.await_driving()
    cut_s = time.monotonic()
    cable.whole = False
    dead_after_s = mesh.motors.dead_after_s(cut_s)
    assert dead_after_s < STOPPED_WITHIN_S
    until(lambda: mesh.names("bridge"), what="the reason in the command center")
    cable.whole = True
    mesh.motors.await_driving(cut_s + dead_after_s)


def test_mapping_goes_on_without_recorder_visualizer_and_command_center(mesh: Running) -> None:
    mesh.motors.await_driving()
    children = children_of(mesh.run_dir)
    laptop = [children[name] for name in ("recorder", "visualizer")]
    mesh.center.close()
    robot = RobotMap(mesh.bus)
    mesh.bus.take(PERMIT)
    for pid in laptop:
        freeze(pid)
    try:
        until(lambda: "recorder" not in mesh.bus.alive_tokens(), what="the loss of the recorder")
        known, permits = len(robot.points()), []

        def grown() -> bool:
            permits.extend(mesh.bus.take(PERMIT))
            return len(robot.points()) > known + 20

        until(grown, 30.0, "more of the map")
    finally:
        for pid in laptop:
            thaw(pid)
        mesh.center = Center(mesh.config)
    assert [permit.reason for permit in permits if not permit.granted] == []


def readers(topic: Topic[object]) -> set[str]:
    """The processes that look at it: the robot's messages reach the recorder through comm's outbox, where they are
    judged, and of the laptop's status comm looks at none that it was not told to require."""
    through_comm = {"recorder": "comm"} if topic in ROBOT_RECORDED else {}
    found = {through_comm.get(consumer, consumer) for consumer in topic.consumers}
    return found - {"comm"} if topic in LAPTOP_RECORDED and topic.payload is Status else found


_REPORT = re.compile(r"(?:undecodable|no message) topic=(\S+)")


@pytest.mark.parametrize(
    "payloads",
    [junk, pytest.param(huge, marks=[pytest.mark.slow, pytest.mark.timeout(300)])],
)
def test_what_is_no_message_is_reported_by_all_who_read_its_topic_and_the_mission_goes_on(
    mesh: Running, payloads: Callable[[], list[bytes]]
) -> None:
    mesh.motors.await_driving()
    children = children_of(mesh.run_dir)
    logs = {name: mesh.run_dir / "process" / f"{name}.log" for name in children}
    silent = {(reader, topic.key) for topic in TOPICS for reader in readers(topic) if reader in children}
    begun = {name: file.stat().st_size for name, file in logs.items()}

    def reported() -> bool:
        # Again and again: the next sound message takes the place of one that nobody has looked at
        throw(mesh.config, payloads(), sorted({key for _, key in silent}))
        for name, file in logs.items():
            found = _REPORT.findall(file.read_text(encoding="utf-8")[begun[name] :])
            silent.difference_update((name, key) for key in found)
        return not silent

    until(reported, 120.0, silent)
    mesh.motors.await_driving()
    assert children_of(mesh.run_dir) == children


@pytest.mark.requirement("CC_MR_04")
def test_estop_latches_and_only_a_resume_moves_the_robot_again(mesh: Running) -> None:
    mesh.motors.await_driving()
    asked_s = time.monotonic()
    mesh.command("estop")
    mesh.motors.dead_after_s(asked_s)
    until(lambda: mesh.permit.stop_sources == ("operator",))
    assert mesh.motors.stands()
    assert "release the stop first" in mesh.refused("resume")
    mesh.command("release")
    assert "under way already" in mesh.refused("start")
    until(lambda: not mesh.permit.stop_sources, what="the release")
    assert mesh.motors.stands()
    resumed_s = time.monotonic()
    mesh.command("resume")
    mesh.motors.await_driving(resumed_s)


def test_a_planner_that_is_restarted_during_a_stop_waits_for_a_resume(mesh: Running) -> None:
    mesh.motors.await_driving()
    mesh.command("estop")
    planner = children_of(mesh.run_dir)["planner"]
    os.kill(planner, signal.SIGKILL)
    until(lambda: children_of(mesh.run_dir).get("planner", planner) != planner, 10.0, "the restart")
    mesh.command("release")
    until(lambda: (view := mesh.bus.latest(PLAN)) is not None and view.mode == "WAITING", what="the planner's view")
    assert mesh.motors.stands()
    resumed_s = time.monotonic()
    mesh.command("resume")
    mesh.motors.await_driving(resumed_s)
