"""Links as they are: gone, coming and going, lossy, late. Nothing is lost, and the robot stands when it must.

The laptop, or the Raspberry Pi, is a network namespace behind a `Radio`; the robot is this machine.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from common.config import CommSection, VisualizerSection, with_camera
from common.config_file import config_text
from common.messages.mission import Operation, OperatorCommand
from common.messages.topics import OPERATION, PLAN, STATUS
from deploy.local.ports import reserve_port
from deploy.local.process_table import PROCESSES
from offboard.simulator.run.options import FLOORS
from offboard.simulator.run.process import MOTORS_NAME
from tests.system.center import Center
from tests.system.conftest import Mesh, until
from tests.system.main_thread import hold_main_thread, let_go
from tests.system.motors import STOPPED_WITHIN_S, MotorLog
from tests.system.page import page_map
from tests.system.radio import Radio, open_radio
from tests.system.recording import Recording, RobotMap

pytestmark = pytest.mark.timeout(120)

ONLOOKERS = Path(__file__).with_name("onlookers.py")


@pytest.fixture
def radio() -> Iterator[Radio]:
    made = open_radio()
    yield made
    made.close()


@pytest.fixture
def mesh(tmp_path: Path, radio: Radio) -> Iterator[Mesh]:
    made = Mesh(tmp_path, radio.here)
    made.config = replace(made.config, comm=CommSection(required=("bridge", "mmu", "poi")))
    made.config_file.write_text(config_text(made.config), encoding="utf-8")
    yield made
    made.close()


def watched(mesh: Mesh, span_s: float) -> None:
    """So long; meanwhile the robot, which may drive, goes on."""
    if "bridge" not in mesh.processes:  # without whose word on stops comm grants nothing
        mesh.start("bridge")
    until(lambda: mesh.granted, what="the permit")
    begin, end_s = len(mesh.permits), time.monotonic() + span_s
    until(lambda: time.monotonic() > end_s, 2 * span_s)
    permits = [permit for _, permit in mesh.permits[begin:]]
    # A busy machine may starve a module for a moment; a comm that waits for the link would stand all the time
    granted = sum(permit.granted for permit in permits)
    assert granted > 0.8 * len(permits), [permit.reason for permit in permits if not permit.granted]


@pytest.mark.requirement("CM_MR_01")
def test_a_link_that_loses_packets_and_then_is_late_leaves_no_hole_and_no_double(mesh: Mesh, radio: Radio) -> None:
    recording = Recording(mesh, inside=radio.enter)
    radio.loss = 0.2
    watched(mesh, 5.0)
    radio.loss, radio.delay_s = 0.0, 0.2
    watched(mesh, 2.0)
    until(recording.more(100), 30.0, "messages over the late link")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.requirement("CM_MR_01", "CM_MR_02")
def test_many_who_look_on_and_are_out_of_reach_all_at_once_hold_up_nothing_on_the_robot(
    mesh: Mesh, radio: Radio
) -> None:
    Recording(mesh, inside=radio.enter)
    mesh.start("onlookers", str(ONLOOKERS), "5", inside=radio.enter)
    until(lambda: "seen" in (mesh.folder / "onlookers.stdout").read_text(encoding="utf-8"), 20.0, "the onlookers")
    radio.up = False
    watched(mesh, 8.0)  # in which their links are given up, and closed


@pytest.mark.slow
@pytest.mark.requirement("CM_MR_01", "CM_MR_02")
def test_a_link_that_is_late_by_half_a_second_and_loses_packets_holds_up_nothing_on_the_robot(
    mesh: Mesh, radio: Radio
) -> None:
    recording = Recording(mesh, inside=radio.enter)
    radio.loss, radio.delay_s = 0.15, 0.5
    watched(mesh, 25.0)
    radio.loss, radio.delay_s = 0.0, 0.0
    until(recording.more(300), 30.0, "what was said meanwhile")
    recording.assert_once_and_in_order(recording.silence())


def start_page(mesh: Mesh, radio: Radio, recording: Recording) -> int:
    """The visualizer on the laptop, where it joins the laptop's own router; returns its port."""
    port = reserve_port()
    laptop = replace(mesh.config.mesh, router=mesh.config.mesh.laptop_router)
    config = replace(mesh.config, mesh=laptop, visualizer=VisualizerSection(host="0.0.0.0", port=port))
    file = mesh.folder / "page.toml"
    file.write_text(config_text(config), encoding="utf-8")
    extra = ("--config", str(file), "--run-dir", str(recording.run_dir))
    mesh.start("visualizer", "-m", "offboard.visualizer", extra=extra, inside=radio.enter)
    return port


@pytest.mark.slow
@pytest.mark.requirement("CM_MR_01")
def test_a_link_that_flaps_every_three_seconds_leaves_no_hole_and_the_page_shows_the_robots_map(
    mesh: Mesh, radio: Radio
) -> None:
    recording = Recording(mesh, inside=radio.enter)
    port = start_page(mesh, radio, recording)
    for _ in range(8):
        radio.up = not radio.up
        watched(mesh, 3.0)
    assert radio.up
    until(recording.more(50), 30.0, "messages over the link again")
    robot = RobotMap(mesh.bus)

    def shown() -> bool:
        page = page_map(radio.there, port, len(robot.points()))
        return len(page) > 0 and np.array_equal(page, robot.points())

    until(shown, 20.0, "the map on the page")
    recording.assert_once_and_in_order(recording.silence())


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.requirement("CM_MR_01")
def test_ten_minutes_without_wifi_on_the_scaled_clock_leave_no_hole_and_no_double(mesh: Mesh, radio: Radio) -> None:
    mesh.start("simulator", extra=("--clock", "shared", "--speed", "20"))
    recording = Recording(mesh, inside=radio.enter, extra=("--clock", "shared"))
    mesh.bus.latest(STATUS["mmu"])

    def simulated_s() -> float:
        status = mesh.bus.latest(STATUS["mmu"])
        return status.t_s if status is not None else 0.0

    radio.up = False
    gone_s = simulated_s()
    until(lambda: simulated_s() - gone_s >= 600.0, 180.0, "ten minutes of the mission")
    stored = recording.stored()
    radio.up = True
    until(recording.more(50), 30.0, f"messages beyond the {stored} of before")
    recording.assert_once_and_in_order(recording.silence(120.0))


@pytest.mark.requirement("CM_MR_02", "CAR_MR_02", "CC_MR_02")
def test_the_raspberry_pi_cut_off_stuck_frozen_or_killed_stops_the_robot_which_says_why_and_drives_again(
    mesh: Mesh, radio: Radio
) -> None:
    mesh.config = with_camera(mesh.config)
    mesh.config_file.write_text(config_text(mesh.config), encoding="utf-8")
    for name in ("comm", "mmu", "planner"):
        mesh.start(name, "-m", PROCESSES[name])
    mesh.start("poi", inside=radio.enter)
    mesh.start("simulator", "-m", PROCESSES["simulator"], extra=("--floor", str(FLOORS / "loop.json")))
    until((mesh.folder / "serial").exists, 30.0, "the serial port")
    mesh.start("bridge", "-m", PROCESSES["bridge"])
    mesh.bus.latest(PLAN)
    center = Center(mesh.config)
    try:
        until(lambda: mesh.granted, 60.0, "the permit")

        def started() -> bool:
            mesh.bus.publish(OPERATION, OperatorCommand(time.monotonic(), Operation.START))
            view = mesh.bus.latest(PLAN)
            return view is not None and view.mode != "WAITING"

        until(started, 30.0, "the start")
        motors = MotorLog(mesh.folder / MOTORS_NAME)
        motors.await_driving()
        pid = mesh.processes["poi"].pid
        for hit, undo in (
            (lambda: setattr(radio, "up", False), lambda: setattr(radio, "up", True)),
            (lambda: hold_main_thread(pid), lambda: let_go(pid)),
            (lambda: os.kill(pid, signal.SIGSTOP), lambda: os.kill(pid, signal.SIGCONT)),
            (lambda: os.kill(pid, signal.SIGKILL), lambda: mesh.start("poi", inside=radio.enter)),
        ):
            hit_s = time.monotonic()
            hit()
            dead_after_s = motors.dead_after_s(hit_s)
            assert dead_after_s < STOPPED_WITHIN_S
            until(lambda: "poi" in _reason(center), what="the reason in the command center")
            undo()
            motors.await_driving(hit_s + dead_after_s)
    finally:
        center.close()


def _reason(center: Center) -> str:
    permit = center.node.snapshot().permit
    return permit.reason if permit is not None else ""
