"""Page and terminal on one robot at once: one stop epoch for both, on the robot's own processes and real firmware."""

from __future__ import annotations

import dataclasses
import json
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import WebSocketException

from common.config import VisualizerSection
from common.config_file import config_text
from deploy.local.ports import reserve_port
from tests.page_socket import page_socket
from tests.system.conftest import until
from tests.system.motors import STANDS_FOR_S
from tests.system.page import frames
from tests.system.robot import Robot

pytestmark = [pytest.mark.timeout(180), pytest.mark.slow]


class OpenPage:
    """A page that somebody has open: what it was told last, by channel."""

    def __init__(self, address: str) -> None:
        self.heard: dict[str, dict[str, Any]] = {}
        self._socket = page_socket(address)
        self._page = self._socket.__enter__()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with suppress(WebSocketException, OSError, TimeoutError):
            while True:
                head, _ = self._page.next(10.0)
                self.heard[head["channel"]] = head

    def order(self, name: str) -> None:
        message = {"order": name} | ({} if name == "stop" else {"token": self.heard["hello"]["token"]})
        self._page.connection.send(json.dumps(message))

    @property
    def stop(self) -> str:
        return str(self.heard.get("operator", {}).get("stop", ""))

    def close(self) -> None:
        self._page.connection.close()
        self._thread.join(5.0)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with closing(Robot(tmp_path)) as made:
        yield made


@pytest.fixture
def page(robot: Robot) -> Iterator[OpenPage]:
    port = reserve_port()
    config = dataclasses.replace(robot.config, visualizer=VisualizerSection(port=port))
    robot.config_file.write_text(config_text(config), encoding="utf-8")
    robot.start("visualizer", "-m", "offboard.visualizer", extra=("--run-dir", str(robot.folder)))
    until(lambda: next(frames("127.0.0.1", port), None) is not None, 20.0, "the page")
    with closing(OpenPage(f"http://127.0.0.1:{port}/")) as made:
        yield made


@pytest.mark.requirement("CC_MR_04")
def test_page_and_terminal_that_act_at_once_obey_one_stop_epoch(robot: Robot, page: OpenPage) -> None:
    """30 s."""
    robot.drive()
    desk = robot.center.node.stop_desk
    until(lambda: page.stop == "IDLE", 20.0, "the page's view of the robot")

    before = robot.permit.stop_epoch
    page.order("stop")
    desk.press()
    until(lambda: desk.control.latency_s is not None and page.stop == "LATCHED", what="both having their confirmation")
    latched = robot.permit.stop_epoch
    assert latched > before
    assert robot.motors.stands()

    until(lambda: not desk.hindrance(), what="a stop that may be released")
    page.order("stop")
    desk.release()  # of the epoch before that press, or just ahead of it
    until(lambda: robot.permit.stop_epoch > latched and page.stop == "LATCHED", what="the press being held")
    page.order("resume")
    time.sleep(STANDS_FOR_S)
    assert robot.permit.stop_sources == ("operator",), "neither the release of an older stop nor a resume lets it go"
    assert robot.motors.stands()
    refusal = "The robot did not take the resume: stopped by operator."
    until(lambda: page.heard["operator"]["answer"] == refusal, what="the answer to that resume")

    robot.release()
    until(lambda: page.stop == "RELEASED", what="the page's view of the release")
    assert robot.motors.stands()
    resumed_s = time.monotonic()
    page.order("resume")
    robot.motors.await_driving(resumed_s)
    until(lambda: page.stop == "IDLE", what="the page's view of a robot that drives")
