"""The run database holds what was said, once and in order, whatever is killed or cut off meanwhile."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgpack
import numpy as np
import pytest

from common.clock import FreeClock
from common.config_file import load_config
from common.errors import ErrorCode
from common.messages.topics import LAPTOP_RECORDED, POSE, ROBOT_RECORDED, STATUS, TOPICS
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import MESSAGE_BYTES_MAX
from deploy.bench.relay import Relay
from offboard.runs.run_database import RunReader
from tests.system.conftest import ROOT, Mesh, children_of, environment, run_cli, until
from tests.system.junk import huge, junk, throw
from tests.system.page import page_map
from tests.system.recording import Recording, RobotMap, Said, recorded_map

pytestmark = pytest.mark.timeout(120)
EVERY_TOPIC = [topic.key for topic in TOPICS]
# What is too long goes to these alone; on every topic it is half a gigabyte at once, which a slow test has
OF_BRIDGE = [topic.key for topic in TOPICS if topic.bundle_key == "bridge/bundle"]


@pytest.fixture
def recording(mesh: Mesh) -> Recording:
    return Recording(mesh)


def error_of_recorder(mesh: Mesh) -> int | None:
    """As it reports itself; None before it is heard."""
    status = mesh.bus.latest(STATUS["recorder"])
    return status.error_code if status is not None else None


@pytest.mark.requirement("CM_MR_01")
def test_recorder_killed_again_and_again_leaves_no_hole_and_no_double(recording: Recording) -> None:
    for _ in range(3):
        recording.kill("recorder")
        until(recording.more(50), 20.0, "messages in the database again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01")
def test_comm_killed_again_and_again_leaves_no_hole_and_no_double(recording: Recording) -> None:
    for _ in range(3):
        recording.kill("comm", down_s=1.0)
        until(recording.more(50), 20.0, "messages in the database again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01")
def test_what_was_said_while_the_recorder_was_away_arrives_from_the_robots_disk(recording: Recording) -> None:
    recorder = recording.mesh.processes["recorder"]
    recorder.send_signal(signal.SIGTERM)
    assert recorder.wait(10.0) == 0
    said = {}
    for name in ("mmu", "poi"):
        recording.mesh.processes[name].send_signal(signal.SIGTERM)
        assert recording.mesh.processes[name].wait(10.0) == 0
    said = recording.said()
    # The robot restarts before the laptop is there again: nobody but the disk knows what was said
    time.sleep(0.5)
    recording.kill("comm", down_s=0.1)
    recording.start("recorder")
    until(lambda: recording.missing(said) == {}, 20.0, "the rest in the database")
    recording.assert_once_and_in_order(said)


@pytest.mark.requirement("CM_MR_01")
def test_a_robot_whose_disk_falls_back_in_time_leaves_no_hole_and_no_double(recording: Recording) -> None:
    disk = {file: file.read_bytes() for file in recording.mesh.folder.glob("outbox.sqlite*")}
    until(recording.more(150), 20.0, "messages that the disk will have forgotten")
    recording.end("comm")
    for file, data in disk.items():
        file.write_bytes(data)
    recording.start("comm")
    until(recording.more(50), 20.0, "messages in the database again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01")
def test_what_is_said_after_the_run_folder_was_deleted_is_in_a_new_one(recording: Recording) -> None:
    shutil.rmtree(recording.run_dir)
    until(lambda: recording.stored() > 100, 20.0, "messages in another database")
    until(lambda: error_of_recorder(recording.mesh) == ErrorCode.DATABASE_LOST, 5.0, "the report of the loss")
    for name in ("mmu", "poi"):
        recording.mesh.processes[name].send_signal(signal.SIGTERM)
        assert recording.mesh.processes[name].wait(10.0) == 0
    until_the_end = {POSE.key, STATUS["mmu"].key, STATUS["poi"].key}
    said = {source: newest for source, newest in recording.said().items() if source[0] in until_the_end}

    def newest() -> Said:
        with RunReader(recording.run_dir) as run:
            return {source: run.senders().get(source, (0, 0))[0] for source in said}

    until(lambda: newest() == said, 20.0, "the rest in the database")
    with RunReader(recording.run_dir) as run:
        assert run.dropped() == {}


class Witness:
    """Hears what all modules of a running `local` say, beside the recorder."""

    def __init__(self, config_file: Path) -> None:
        self.heard: Said = {}
        self._bus = ZenohBus("witness", load_config(config_file), FreeClock())
        self._bus.record((*ROBOT_RECORDED, *LAPTOP_RECORDED), {})

    def listen(self) -> None:
        for message in self._bus.take_recorded():
            self.heard[message.key, message.boot_id] = message.sequence

    def close(self) -> None:
        self._bus.close()


@pytest.fixture
def options() -> tuple[str, ...]:
    """Of `local`, besides the usual ones."""
    return ()


@pytest.fixture
def local(tmp_path: Path, options: tuple[str, ...]) -> Iterator[subprocess.Popen[str]]:
    """A headless run; `tmp_path / "run"` is its folder."""
    arguments = ["local", "--floor", "straight", "--headless", *options, "--out", str(tmp_path / "run")]
    with (tmp_path / "output.txt").open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "deploy.cli", *arguments], env=environment(), cwd=ROOT, stdout=output, stderr=output
        )
    yield process
    process.terminate()
    process.wait(45.0)


def assert_one_map_everywhere(run_dir: Path) -> None:
    """On the robot, in the database and on the page, of a mission that is paused here."""
    config_file = run_dir / "process" / "robot.toml"
    config = load_config(config_file)
    bus = ZenohBus("observer", config, FreeClock())
    try:
        robot = RobotMap(bus)
        until(lambda: len(robot.points()) > 0, 40.0, "a map")
        until(lambda: run_cli("pause", "--config", str(config_file)).returncode == 0, 30.0, "the pause")

        def same() -> bool:
            points = robot.points()
            page = page_map(config.visualizer.host, config.visualizer.port, len(points))
            return np.array_equal(recorded_map(run_dir), points) and np.array_equal(page, points)

        until(same, 20.0, "the same map everywhere")
    finally:
        bus.close()


def rows_left_in_outbox(file: Path) -> Said:
    """Newest sequence number of what the robot still had for the recorder."""
    left: Said = {}
    with sqlite3.connect(file) as database:
        for (row,) in database.execute("SELECT data FROM rows ORDER BY number"):
            for topic, boot_id, sequence, _ in msgpack.unpackb(row)[0]:
                left[topic, boot_id] = sequence
    return left


@pytest.mark.requirement("CM_MR_01")
@pytest.mark.parametrize(
    "options",
    [
        pytest.param((), id="in one process with mmu"),
        pytest.param(("--apart",), id="apart", marks=pytest.mark.slow),
    ],
)
def test_recorder_and_comm_killed_in_a_mission_leave_no_hole_and_no_double(
    local: subprocess.Popen[str], options: tuple[str, ...], tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    missing: Said = {}
    output = tmp_path / "output.txt"
    until(lambda: "mission has started" in output.read_text(encoding="utf-8"), 60.0, "the start")
    witness = Witness(run_dir / "process" / "robot.toml")
    try:
        for victim in ("recorder", "comm", "recorder"):
            pid = children_of(run_dir)[victim]
            os.kill(pid, signal.SIGKILL)

            def back(victim: str = victim, pid: int = pid) -> bool:
                witness.listen()
                return children_of(run_dir).get(victim, pid) != pid

            until(back, 20.0, f"the restart of {victim}")
            heard = dict(witness.heard)

            def stored(heard: Said = heard) -> bool:
                witness.listen()
                with RunReader(run_dir) as run:
                    senders = run.senders()
                behind = {s: newest for s, newest in heard.items() if senders.get(s, (0, 0))[0] < newest}
                missing.clear()
                missing.update(behind)
                return not behind

            until(stored, 30.0, missing)
        if options:  # else the mapping unit was killed as well, and has to map anew
            assert_one_map_everywhere(run_dir)
    finally:
        witness.close()
    local.terminate()
    assert local.wait(45.0) == 130
    with RunReader(run_dir) as run:
        senders, dropped = run.senders(), run.dropped()
    assert dropped == {}
    assert {source: found for source, found in senders.items() if found[0] != found[1]} == {}
    left = rows_left_in_outbox(run_dir / "process" / "outbox.sqlite")
    newest = {source: max(found[0], left.get(source, 0)) for source, found in senders.items()}
    behind = {s: said - newest.get(s, 0) for s, said in witness.heard.items() if said > newest.get(s, 0)}
    assert {s for s in behind if s[0] not in {topic.key for topic in LAPTOP_RECORDED}} == set()


def test_junk_on_every_topic_is_counted_and_reported_and_nothing_falls_over(recording: Recording) -> None:
    throw(recording.mesh.config, junk(), EVERY_TOPIC)
    throw(recording.mesh.config, [bytes(MESSAGE_BYTES_MAX + 1)], OF_BRIDGE)
    until(recording.more(50), 30.0, "messages in the database again")
    for name in ("comm", "recorder"):
        assert recording.mesh.processes[name].poll() is None

    def reported() -> bool:
        with RunReader(recording.run_dir) as run:
            lines = [entry.line.text for entry in run.logs()]
        return all(any(said in line for line in lines) for said in ("no message topic", "undecodable", "too many"))

    until(reported, 20.0, "the report")
    recorded = {topic.key for topic in TOPICS if topic.recorded}

    def undecodable() -> set[str]:
        with RunReader(recording.run_dir) as run:
            return set(run.problems())

    until(lambda: undecodable() == recorded, 20.0, "the undecodable ones of every topic")
    said = recording.silence()
    with RunReader(recording.run_dir) as run:
        assert {source: run.senders()[source] for source in said} == {s: (newest, newest) for s, newest in said.items()}


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_payload_of_100_megabytes_on_every_topic_changes_nothing(recording: Recording) -> None:
    throw(recording.mesh.config, huge(), EVERY_TOPIC)
    until(recording.more(50), 120.0, "messages in the database again")
    said = recording.silence()
    with RunReader(recording.run_dir) as run:
        assert {source: run.senders()[source] for source in said} == {s: (newest, newest) for s, newest in said.items()}


@pytest.fixture
def relay(mesh: Mesh) -> Iterator[Relay]:
    made = Relay(mesh.config.mesh.router)
    yield made
    made.close()


@pytest.mark.slow
@pytest.mark.requirement("CM_MR_01")
def test_a_slow_link_that_comes_and_goes_leaves_no_hole_and_no_double(mesh: Mesh, relay: Relay) -> None:
    relay.delay_s = 0.1
    recording = Recording(mesh, robot=relay.endpoint)
    for k in range(4):
        (relay.cut if k % 2 else relay.silence)()
        time.sleep(1.5)  # longer than the lease: both sides give the link up
        relay.restore()
        until(recording.more(20), 20.0, "messages over the link again")
    recording.assert_once_and_in_order(recording.silence())


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", folder], check=False).returncode:
        pytest.skip("only root can mount a small disk: run the tests with sudo, or in a container")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


@pytest.mark.requirement("CM_MR_01")
def test_a_full_disk_under_the_recorder_costs_nothing_once_there_is_space(mesh: Mesh, small_disk: Path) -> None:
    recording = Recording(mesh, small_disk / "run")
    ballast = small_disk / "ballast"
    with suppress(OSError), ballast.open("wb") as file:
        while True:
            file.write(bytes(4096))
    until(lambda: error_of_recorder(mesh) == ErrorCode.DISK_FULL, 20.0, "the report of the full disk")
    stored = recording.stored()
    time.sleep(2.0)
    assert recording.stored() == stored
    assert mesh.processes["recorder"].poll() is None
    subprocess.run(["mount", "-o", "remount,size=100m", small_disk], check=True)
    ballast.unlink()
    until(lambda: error_of_recorder(mesh) == ErrorCode.OK, 20.0, "the report that there is space")
    recording.assert_once_and_in_order(recording.silence())
