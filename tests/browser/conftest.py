"""The real page in a real Chromium, fed by hand; the clock that ages are judged by is the test's."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from common.constants import MAP_DENSITY_PER_M
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.stop import Permit
from common.messages.topics import MAP, PERMIT, POI, POSE
from deploy.bench.browser import CHROMIUM, chromium
from offboard.operate.bus_operator import Operator
from offboard.visualizer.feed import Feed
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.live_model import NO_RUN, ShownRun
from offboard.visualizer.server import PageServer


# Not for the session: its event loop runs in the main thread, where the terminal's tests need none
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium: sudo apt-get install -y chromium")
    with chromium() as browser:
        yield browser


def photo(colour: str = "#7a5a3a") -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (320, 240), colour).save(out, "JPEG")
    return out.getvalue()


class Robot:
    """Says by hand what a robot says. `late_s` moves the server's clock on."""

    def __init__(self, port: int = 0, run: ShownRun = NO_RUN, operator: Operator | None = None) -> None:
        self.late_s = 0.0
        self.feed = Feed(clock=lambda: time.monotonic() + self.late_s, run=run)
        self.server = PageServer(FeedSite(self.feed, "robot1", operator), "127.0.0.1", port)
        self.server.start()
        self._points = 0

    def pose(self, x_m: float = 1.0, y_m: float = 1.0, *, valid: bool = True) -> None:
        self.feed.take(POSE, PoseEstimate(0.0, x_m, y_m, 0.3, 0.0, 0.02, 0.01, 1, valid))
        self.feed.take(PERMIT, Permit(0.0, True, ""))

    def wall(self, y_m: float, length_m: float = 8.0, *, inferred: bool = False) -> None:
        """A wall from x 0 on, at the density of the specification."""
        xs = np.arange(0.0, length_m, 1.0 / MAP_DENSITY_PER_M)
        points = np.column_stack([xs, np.full(len(xs), y_m)]).astype(np.float32)
        self.feed.take(MAP, MapUpdate(0.0, 1, self._points, points, np.full(len(xs), inferred, np.uint8)))
        self._points += len(xs)

    def door(self, poi_id: int, number: str, room: str = "Office", state: str = "read", jpeg: bytes = b"") -> None:
        place = (0.5 + poi_id % 8, 0.0)
        poi = PointOfInterest(1.0, poi_id, "Door", number, *place, number, room, 0.87, state, jpeg)
        self.feed.take(POI, poi)

    def floor(self) -> None:
        """Two walls, three doors, the robot between them."""
        self.wall(0.0)
        self.wall(2.5)
        self.door(1, "101", "Office", jpeg=photo())
        self.door(2, "102", "Laboratory", jpeg=photo("#336699"))
        self.door(3, "", "", "unread")
        self.pose()


@pytest.fixture
def robot() -> Iterator[Robot]:
    made = Robot()
    yield made
    made.server.close()


class Visit:
    """A page that is open, and every address that it asked for."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.asked: list[str] = []
        self.errors: list[str] = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("websocket", lambda socket: self.asked.append(socket.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)

    def until(self, condition: Callable[[], Any], what: str, deadline_s: float = 8.0) -> None:
        end_s = time.monotonic() + deadline_s
        while not condition():
            assert time.monotonic() < end_s, f"{what} did not come true within {deadline_s} s"
            self.page.wait_for_timeout(20)

    def until_link(self, *states: str) -> None:
        what = f"the link being {' or '.join(states)}"
        self.until(lambda: self.page.evaluate("document.body.dataset.link") in states, what)

    def until_live(self, robot: Robot) -> None:
        """While the robot goes on saying where it is."""
        live = "document.body.dataset.link === 'live'"
        self.until(lambda: robot.pose() or self.page.evaluate(live), "the link being live")

    def wall_pixels(self) -> int:
        """How many pixels of the canvas have the colour of walls."""
        count: int = self.page.evaluate(
            """() => {
                const canvas = document.getElementById("base");
                const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
                const wall = getComputedStyle(document.documentElement).getPropertyValue("--map-wall");
                const [r, g, b] = wall.match(/\\w\\w/g).map((hex) => parseInt(hex, 16));
                let count = 0;
                for (let k = 0; k < data.length; k += 4)
                    if (Math.abs(data[k] - r) + Math.abs(data[k + 1] - g) + Math.abs(data[k + 2] - b) < 24) count++;
                return count;
            }"""
        )
        return count


@pytest.fixture
def visit(browser: Browser) -> Iterator[Callable[..., Visit]]:
    """Opens the page of a robot; whatever it logs as an error fails the test."""
    opened = []

    def open_page(robot: Robot | None, address: str = "", at: str = "", **options: Any) -> Visit:
        context = browser.new_context(**({"viewport": {"width": 1280, "height": 800}} | options))
        visit = Visit(context.new_page())
        opened.append((context, visit))
        visit.page.goto(at or (robot.server.address if robot else "") + address)
        return visit

    yield open_page
    for context, _ in opened:
        context.close()
    assert [error for _, visit in opened for error in visit.errors if "WebSocket" not in error] == []
