"""The page over slow, odd and broken links: the map arrives, and no age is better than the truth."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from common.messages.mapping import MapUpdate
from common.messages.topics import MAP
from tests.browser.conftest import Robot, Visit
from tests.browser.proxy import Proxy

pytestmark = pytest.mark.timeout(90)

Open = Callable[..., Visit]


class Talking:
    """A robot that publishes a pose ten times a second, from a thread of its own; its x is the time."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._ended = threading.Event()
        self._began_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def now_s(self) -> float:
        return time.monotonic() - self._began_s

    def close(self) -> None:
        self._ended.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._ended.wait(0.1):
            self._robot.pose(x_m=self.now_s)


@pytest.fixture
def talking(robot: Robot) -> Iterator[Talking]:
    made = Talking(robot)
    yield made
    made.close()


def big_map(robot: Robot, points: int) -> None:
    """Walls of a floor, 10 points a metre, so many points in all."""
    xs = np.arange(points) % 500 / 10.0
    ys = np.arange(points) // 500 * 2.0
    robot.feed.take(MAP, MapUpdate(0.0, 1, 0, np.column_stack([xs, ys]).astype(np.float32), np.zeros(points, np.uint8)))


POINTS = "import('./main.js').then((page) => page.model.coming.length)"


def points(page: Page) -> int:
    count: int = page.evaluate(POINTS)
    return count


@pytest.mark.requirement("VSL_MR_04")
def test_a_slow_link_brings_the_map_and_no_age_on_the_page_is_wrong_by_a_second(
    robot: Robot, talking: Talking, visit: Open
) -> None:
    """20 kB/s and 300 ms there and back, 10 000 points. A pose's x tells when it was published."""
    big_map(robot, 10_000)
    link = Proxy(robot.server.port, 20_000.0, 0.15)
    try:
        seen = visit(robot, at=link.address)
        seen.until(lambda: seen.page.locator("#progress").is_visible(), "the progress", 30.0)
        wrong_s: list[float] = []
        end_s = time.monotonic() + 40.0
        while points(seen.page) < 10_000:
            assert time.monotonic() < end_s, f"only {points(seen.page)} points have arrived"
            before_s = talking.now_s
            shown = seen.page.evaluate(
                "import('./main.js').then(({ model }) => model.pose && model.clock.ahead !== null"
                " ? [model.pose.x_m, model.age('pose'), model.state] : null)"
            )
            if shown is not None:
                x_m, age_s, state = shown
                looked_s, unsure_s = (before_s + talking.now_s) / 2, (talking.now_s - before_s) / 2
                wrong_s.append(abs(looked_s - x_m - age_s) - unsure_s)
                assert (state == "live") == (age_s <= 1.0) or abs(age_s - 1.0) < 0.05
            seen.page.wait_for_timeout(100)
        assert len(wrong_s) > 10
        assert max(wrong_s) < 1.0
        expect(seen.page.locator("#progress")).to_be_hidden()
    finally:
        link.close()


def test_a_broken_link_goes_on_with_the_map_where_it_was(robot: Robot, talking: Talking, visit: Open) -> None:
    big_map(robot, 10_000)
    link = Proxy(robot.server.port, 40_000.0, 0.05)
    try:
        seen = visit(robot, at=link.address)
        seen.until(lambda: points(seen.page) > 2000, "a part of the map", 30.0)
        link.cut()
        seen.until_link("lost")
        least = points(seen.page)
        counts = []
        seen.until(lambda: counts.append(points(seen.page)) or counts[-1] == 10_000, "the map", 30.0)
        assert min(counts) >= least > 2000
    finally:
        link.close()


def test_a_page_that_slept_is_not_live_over_what_waited_for_it(robot: Robot, visit: Open) -> None:
    """While a browser stands still its socket goes on taking messages: none of them is new when it wakes."""
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    seen.page.evaluate(
        """() => {
            window.shown = [];
            setTimeout(() => {
                const end = Date.now() + 3000;
                while (Date.now() < end);
                const note = () => window.shown.push(document.body.dataset.link);
                new MutationObserver(note).observe(document.body, { attributeFilter: ["data-link"] });
            }, 200);
        }"""
    )
    for _ in range(8):  # then the robot is silent, and the page still stands
        robot.pose()
        time.sleep(0.1)
    seen.until(lambda: seen.page.evaluate("window.shown.length") > 0, "the page being awake")
    seen.page.wait_for_timeout(1000)
    assert "live" not in seen.page.evaluate("window.shown")


def test_a_machine_that_slept_knows_how_old_its_data_are(robot: Robot, visit: Open) -> None:
    """A sleeping machine stops the browser's counter, and its sockets may seem open when it wakes."""
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    shown = seen.page.evaluate(
        """() => {
            const time = Date.now;
            Date.now = () => time() + 600000;
            return import("./main.js").then(({ model }) => [model.state, model.age("pose")]);
        }"""
    )
    assert shown[0] in ("stale", "silent")
    assert shown[1] == pytest.approx(600.0, abs=5.0)


def test_a_proxy_that_changes_the_host_is_named_as_the_reason(robot: Robot, visit: Open) -> None:
    robot.floor()
    own = b"Host: 127.0.0.1:%d" % robot.server.port
    link = Proxy(robot.server.port, changed=lambda data: re.sub(rb"Host: [\w.:]+", own, data))
    try:
        seen = visit(robot, at=link.address)
        expect(seen.page.locator("#banner")).to_contain_text("a proxy between them changes the Host header")
        seen.errors.clear()  # the browser's own words about its socket
    finally:
        link.close()


def test_a_proxied_folder_is_opened_without_its_slash_too(robot: Robot, visit: Open) -> None:
    robot.floor()

    def only_that(found: re.Match[bytes]) -> bytes:
        return b"GET /" if found[1] else b"GET /of-another-program/"

    link = Proxy(robot.server.port, changed=lambda data: re.sub(rb"GET /(robot/?)?", only_that, data))
    try:
        seen = visit(robot, at=f"{link.address}robot#poi=2")
        expect(seen.page).to_have_url(f"{link.address}robot/#poi=2")
        seen.until_live(robot)
        expect(seen.page.get_by_role("dialog")).to_contain_text("Laboratory 102")
        seen.errors.clear()  # of what the page requested before it knew its address
    finally:
        link.close()
