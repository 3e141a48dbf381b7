"""The visualizer as a process of the real mesh: killed and started again, it fills its pages again."""

from __future__ import annotations

import dataclasses
import json
import socket
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from math import inf
from typing import Any

import numpy as np
import pytest

from common.clock import FreeClock
from common.config import VisualizerSection
from common.config_file import config_text
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.mission import Operation
from common.messages.topics import MAP, OPERATION, PERMIT, POSE, STATUS
from common.zenoh_bus import ZenohBus
from deploy.local.ports import reserve_port
from offboard.runs import run_folder
from tests.page_socket import PageSocket, page_socket
from tests.system.conftest import Mesh, until
from tests.system.page import frames

pytestmark = pytest.mark.timeout(60)

FILES = 400  # that the page's process may open

DOOR: dict[str, Any] = {"poi_id": 4, "name": "Door", "x_m": 1.0, "y_m": 2.0, "number": "101", "room_type": "Office"}


@pytest.fixture
def port(mesh: Mesh) -> int:
    found = reserve_port()
    config = dataclasses.replace(mesh.config, visualizer=VisualizerSection(port=found))
    mesh.config_file.write_text(config_text(config), encoding="utf-8")
    return found


@pytest.fixture
def mmu(mesh: Mesh) -> Iterator[ZenohBus]:
    mesh.start("comm")
    until(lambda: "comm" in mesh.bus.alive_tokens(), 20.0, "the router")
    laptop = ZenohBus("recorder", mesh.config, FreeClock(), "router")
    bus = ZenohBus("mmu", mesh.config, FreeClock())
    yield bus
    bus.close()
    laptop.close()


def start(mesh: Mesh) -> None:
    mesh.start("visualizer", "-m", "offboard.visualizer", extra=("--run-dir", str(mesh.folder)))


def read_until(port: int, complete: Callable[[dict[str, Any]], bool], say: Callable[[], None]) -> dict[str, Any]:
    """Opens the page's socket as soon as it is there and reads heads of frames, newest by channel, until `complete`."""
    heard: dict[str, Any] = {}
    end_s = time.monotonic() + 20.0
    while time.monotonic() < end_s:
        say()
        for frame, _ in frames("127.0.0.1", port):
            say()
            heard[frame["channel"]] = frame
            if complete(heard):
                return heard
            if time.monotonic() > end_s:
                break
    pytest.fail(f"the page heard only {heard}")


@pytest.mark.requirement("VSL_MR_01", "VSL_MR_05")
def test_a_killed_visualizer_fills_its_pages_again(mesh: Mesh, mmu: ZenohBus, port: int) -> None:
    run_folder.write_json(mesh.folder / run_folder.POIS_NAME, [DOOR])
    for start_at in (0, 10):
        points = np.zeros((10, 2), np.float32)
        mmu.publish(MAP, MapUpdate(0.0, 1, start_at, points, np.zeros(10, np.uint8)))

    def say() -> None:
        mmu.publish(POSE, PoseEstimate(0.0, 1.0, 2.0, 0.0, 0.0, 0.01, 0.01, 1))
        time.sleep(0.05)

    def complete(heard: dict[str, Any]) -> bool:
        heartbeat = heard.get("heartbeat", {"now_s": 0.0, "arrived_s": {}})
        fresh = heartbeat["now_s"] - heartbeat["arrived_s"].get("pose", -inf) < 1.0
        newest = heard.get("map", {"start": 0, "count": 0})  # the whole map at once, or its last piece
        return fresh and newest["start"] + newest["count"] == 20 and {"pose", "pois"} <= set(heard)

    for _ in range(2):
        start(mesh)
        heard = read_until(port, complete, say)
        assert [poi["number"] for poi in heard["pois"]["pois"]] == ["101"]
        until(lambda: mesh.bus.latest(STATUS["visualizer"]), what="its status")
        mesh.processes["visualizer"].kill()
        mesh.processes["visualizer"].wait()


def test_the_page_stops_and_orders_by_the_same_path_as_the_terminal(mesh: Mesh, mmu: ZenohBus, port: int) -> None:
    start(mesh)
    stopped(mesh), mesh.bus.take(OPERATION)  # which joins
    until(lambda: next(frames("127.0.0.1", port), None) is not None, 20.0, "the page")
    with page_socket(f"http://127.0.0.1:{port}/") as page:
        token = page.of_channel("hello")[0]["token"]
        until(lambda: page.of_channel("operator", 10.0)[0]["stop"] != "LINK_LOST", 20.0, "the robot")
        page.connection.send(json.dumps({"order": "pause", "token": token}))
        until(lambda: read_on(page) and any(o.operation is Operation.PAUSE for o in mesh.bus.take(OPERATION)), 10.0)
        page.connection.send('{"order": "stop"}')
        until(lambda: read_on(page) and stopped(mesh), 10.0, "comm having latched the stop")


def read_on(page: PageSocket) -> bool:
    page.next(5.0)
    return True


def stopped(mesh: Mesh) -> bool:
    permit = mesh.bus.latest(PERMIT)
    return permit is not None and "operator" in permit.stop_sources


def test_more_idle_connections_than_files_leave_the_page_served_and_the_log_short(mesh: Mesh, port: int) -> None:
    mesh.start("comm")
    few_files = ("prlimit", f"--nofile={FILES}")
    mesh.start("visualizer", "-m", "offboard.visualizer", inside=few_files)
    until(lambda: next(frames("127.0.0.1", port), None) is not None, 20.0, "the page")
    with ExitStack() as sockets:
        for _ in range(3 * FILES // 2):
            sockets.enter_context(socket.create_connection(("127.0.0.1", port), timeout=10.0))
        for _ in range(3):
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5.0) as page:
                assert b"<title>Indoor Mapping</title>" in page.read()
        assert next(frames("127.0.0.1", port), None) is not None
    log = (mesh.folder / "visualizer.log").read_text(encoding="utf-8")
    assert "Traceback" not in log
    assert len(log.splitlines()) < 20


def test_a_taken_page_port_is_one_sentence_and_exit_code_2(mesh: Mesh, port: int) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", port))
        other.listen()
        result = mesh.command("node", "visualizer")
    assert result.returncode == 2
    assert f"cannot be served at 127.0.0.1 port {port}" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
