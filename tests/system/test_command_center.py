"""The Command Center against the real mesh: it stops the robot, and fills itself again whenever it is started."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from common.clock import FreeClock
from common.config import Config, RobotSection
from common.config_file import load_config
from common.errors import StartError
from common.messages.health import Status
from common.messages.mission import Operation
from common.messages.topics import AT_ONCE, CARRIER, ODOMETRY, STATUS, TOPICS, QosProfile, Topic
from common.modules import OPTIONAL
from common.zenoh_bus import ZenohBus
from deploy.local.ports import refuse_second_mesh
from offboard.operate.operations import Answer
from offboard.operate.software_stop import Look
from tests.system.center import Center
from tests.system.conftest import ROOT, Mesh, children_of, environment, local_run, run_cli, until

pytestmark = pytest.mark.timeout(120)
SPAN_S = 3.0
# What does not wait for a change
PERIODIC = [
    topic for topic in TOPICS if topic.rate_hz and topic.qos is not QosProfile.STATE and topic.producer not in OPTIONAL
]


@pytest.fixture
def local(tmp_path: Path) -> Iterator[Config]:
    """The configuration of a headless run whose mission has started."""
    with local_run(tmp_path / "run", "--camera", "realistic") as process:
        yield load_config(tmp_path / "run" / "process" / "robot.toml")
        process.send_signal(signal.SIGTERM)
        process.wait(30.0)


def spans(bus: ZenohBus, topics: Iterable[Topic[Any]]) -> dict[Topic[Any], list[Any]]:
    """Everything that came of these topics over SPAN_S of their senders' clocks."""
    kept: dict[Topic[Any], list[Any]] = {topic: [] for topic in topics}

    def enough() -> bool:
        for topic, messages in kept.items():
            messages += bus.take(topic)
        return all(messages and messages[-1].t_s - messages[0].t_s >= SPAN_S for messages in kept.values())

    until(enough, 20.0, "every topic")
    return kept


@pytest.mark.requirement("CC_MR_01", "CC_MR_02", "CC_MR_03", "CC_MR_04")
def test_it_shows_every_module_stops_the_robot_and_fills_itself_again_after_a_restart(local: Config) -> None:
    modules = set(STATUS) - OPTIONAL
    center = Center(local)
    watcher = ZenohBus("watcher", local, FreeClock(), "client")
    try:
        until(lambda: modules <= center.live(), what="a fresh row of every module")
        for topic, messages in spans(watcher, PERIODIC).items():
            rate_hz = (len(messages) - 1) / (messages[-1].t_s - messages[0].t_s)
            assert rate_hz >= 0.9 * topic.rate_hz, f"{topic.key} comes at {rate_hz:.1f} Hz"
            assert rate_hz <= 1.1 * topic.rate_hz or topic.note == AT_ONCE, f"{topic.key} comes at {rate_hz:.1f} Hz"
            if topic.payload is Status:
                assert all(report.state and report.memory_kb > 0 for report in messages), topic.key
                assert all(b.heartbeat_count > a.heartbeat_count for a, b in pairwise(messages)), topic.key
        until(lambda: center.node.snapshot().pose is not None and len(center.node.floor_picture().walls_m), 60.0, "map")

        carrier = center.bus.latest(CARRIER)
        assert carrier is not None
        until(lambda: not _standing(watcher), 60.0, "motion")
        center.node.stop_desk.press()
        until(lambda: center.node.stop_desk.control.latency_s is not None, 5.0, "the robot's confirmation")
        latency_s = center.node.stop_desk.control.latency_s
        assert latency_s is not None
        assert latency_s < 1.0
        assert _standing(watcher)
        assert center.node.snapshot().look is Look.LATCHED

        center.close()
        center = Center(local)
        until(lambda: modules <= center.live(), what="a fresh row of every module after the restart")
        until(lambda: len(center.node.floor_picture().walls_m), what="the map after the restart")
        assert center.node.snapshot().look is Look.LATCHED
        assert center.node.snapshot().view is not None

        center.node.stop_desk.release()
        until(lambda: center.node.snapshot().look is Look.RELEASED, what="the release")
        assert _standing(watcher)
        center.node.operate(Operation.RESUME)
        until(lambda: _answer(center) is Answer.TAKEN, what="the planner's acknowledgement")
        until(lambda: not _standing(watcher), 60.0, "motion after the resume")
    finally:
        watcher.close()
        center.close()


def _standing(bus: ZenohBus) -> bool:
    odometry = bus.latest(ODOMETRY)
    return odometry is not None and odometry.standing


def _answer(center: Center) -> Answer | None:
    result = center.node.snapshot().operation
    return result.answer if result is not None else None


def test_an_operation_that_nobody_takes_says_so_in_one_sentence_and_ends_with_1(mesh: Mesh) -> None:
    mesh.start("comm")
    until(lambda: "comm" in mesh.bus.alive_tokens())
    result = mesh.command("home")
    assert result.returncode == 1
    assert result.stderr.strip() == "Nobody answered the home: is the planner running?"


def test_a_stated_pose_is_answered_by_the_mapping_unit_in_one_sentence(mesh: Mesh) -> None:
    mesh.start("comm")
    mesh.start("mmu", "-m", "onboard.mmu")
    until(lambda: {"comm", "mmu"} <= set(mesh.bus.alive_tokens()))
    result = mesh.command("pose", "-1,2,90")
    assert result.returncode == 1
    assert result.stderr.strip() == "Refused. Nothing is received from the wheels or the sonars."


def test_an_unknown_door_is_one_sentence_with_the_known_ones(mesh: Mesh) -> None:
    mesh.start("comm")
    until(lambda: "comm" in mesh.bus.alive_tokens())
    pois = '[{"poi_id": 1, "number": "214", "x_m": 1.0, "y_m": 2.0}]'
    (mesh.folder / "pois.json").write_text(pois, encoding="utf-8")
    result = mesh.command("goto", "kitchen", "--run-dir", str(mesh.folder))
    assert result.returncode == 2
    assert "There is no door kitchen: known are 214" in result.stderr


def test_help_of_node_needs_no_name() -> None:
    result = run_cli("node", "--help")
    assert result.returncode == 0
    assert "planner" in result.stdout


def test_without_a_terminal_it_is_one_sentence() -> None:
    result = run_cli("command-center", stdin=subprocess.DEVNULL)
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert "needs a terminal" in result.stderr


class Terminal:
    """`indoor-mapping local` in a terminal of its own; `screen` is everything it has painted."""

    def __init__(self, *arguments: str) -> None:
        self.screen = b""
        self.pid, self._terminal = pty.fork()
        if self.pid == 0:
            os.environ.update(environment() | {"TERM": "xterm-256color", "COLUMNS": "140", "LINES": "40"})
            os.chdir(ROOT)
            os.execv(sys.executable, [sys.executable, "-m", "deploy.cli", *arguments])

    def shows(self, text: str) -> bool:
        with suppress(OSError):
            while select.select([self._terminal], [], [], 0.0)[0]:
                self.screen += os.read(self._terminal, 65536)
        return text.encode() in self.screen

    def press(self, keys: bytes) -> None:
        self.screen = b""
        os.write(self._terminal, keys)

    def close(self) -> int:
        """Exit code; kills what still runs."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if not pid:
            os.kill(self.pid, signal.SIGKILL)
            _, status = os.waitpid(self.pid, 0)
        os.close(self._terminal)
        return os.waitstatus_to_exitcode(status)

    def ended(self) -> bool:
        self.shows("")
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def test_a_second_local_of_the_same_robot_is_refused_in_one_sentence(mesh: Mesh, tmp_path: Path) -> None:
    mesh.start("comm", "-m", "onboard.comm")
    until(lambda: "comm" in mesh.bus.alive_tokens(), 20.0, "the first mesh")
    with pytest.raises(StartError, match=r"A mesh of robot1 runs already at .*comm.*--headless"):
        refuse_second_mesh(mesh.config)
    elsewhere = replace(mesh.config, robot=RobotSection("robot2"))
    refuse_second_mesh(elsewhere)


def test_local_opens_it_in_its_terminal_and_leaving_ends_the_mesh_when_asked_to(tmp_path: Path) -> None:
    terminal = Terminal("local", "--floor", "straight", "--out", str(tmp_path / "run"))
    code = None
    try:
        until(lambda: terminal.shows("SOFTWARE STOP"), 60.0, "the Command Center")
        until(lambda: terminal.shows("link live"), 20.0, "the link")
        terminal.press(b"q")
        until(lambda: terminal.shows("End everything"), 10.0, "the question")
        terminal.press(b"\x1b[C\x1b[C\r")
        until(terminal.ended, 40.0, "the end of local")
    finally:
        code = terminal.close()
    assert code == 130
    until(lambda: not children_of(tmp_path / "run"), 5.0, "the end of every process")
