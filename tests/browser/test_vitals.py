"""Beside the map: what the sonars receive, how the robot is, and how the page calls a person who looks elsewhere."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from common.errors import ErrorCode
from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.mission import Outcome, PlannerView
from common.messages.motion import CarrierReport, CarrierState, Ranges
from common.messages.topics import CARRIER, PLAN, POSE, RANGES, STATUS
from tests.browser.conftest import Robot, Visit

pytestmark = pytest.mark.timeout(60)

Open = Callable[..., Visit]

# Of the upper canvas: red, green, blue and opacity at a place of the map
PIXEL = """([x, y]) => import('./main.js').then(({ map }) => {
    const [sx, sy] = map.view.toScreen(x, y).map((s) => s * map.ratio);
    return [...map.overlay.getContext("2d").getImageData(sx, sy, 1, 1).data];
})"""


def is_pink(pixel: list[int]) -> bool:
    red, green, blue, opacity = pixel
    return opacity > 80 and red > blue + 20 > green + 60


def test_every_sonar_that_received_an_echo_has_its_ray_and_the_doubt_of_the_pose_its_size(
    robot: Robot, visit: Open
) -> None:
    """The robot at (1, 1) looks along x: left is up."""
    robot.floor()
    robot.feed.take(POSE, PoseEstimate(0.0, 1.0, 1.0, 0.0, 0.0, 0.02, 0.01, 1))
    seen = visit(robot)

    def pink(x_m: float, y_m: float) -> bool:
        robot.feed.take(POSE, PoseEstimate(0.0, 1.0, 1.0, 0.0, 0.0, 0.02, 0.01, 1))
        return is_pink(seen.page.evaluate(PIXEL, [x_m, y_m]))

    robot.feed.take(RANGES, Ranges(0.0, (1.0, float("nan"), 2.0, float("nan"), 0.8), (0.0,) * 5))
    seen.until(lambda: pink(3.0, 1.0), "the ray ahead")
    assert pink(1.0, 1.6), "to the left"
    assert pink(1.0, 0.4), "to the right"
    assert not pink(1.6, 1.6), "where nothing answered"
    assert not pink(3.4, 1.0), "beyond the echo"

    def shown(x_m: float, y_m: float, sd_m: float, **least: float) -> bool:
        robot.feed.take(POSE, PoseEstimate(0.0, 1.0, 1.0, 0.0, 0.0, sd_m, 0.01, 1, **least))
        return bool(seen.page.evaluate(PIXEL, [x_m, y_m])[3])

    away = 0.22 + 0.5  # half a metre beside the robot
    seen.until(lambda: shown(1.0 - away, 0.95, 0.25), "the circle of 0.6 m around it")
    seen.until(lambda: not shown(1.0 - away, 0.95, 0.15), "the circle of 0.4 m around it")
    across = {"sd_least_m": 0.1, "worst_rad": pi / 2}
    seen.until(lambda: shown(1.05, 1.0 + away, 0.25, **across), "the ellipse across its way")
    assert not shown(1.0 - away, 0.95, 0.25, **across), "along its way"

    def sector(sd_rad: float) -> bool:
        robot.feed.take(POSE, PoseEstimate(0.0, 1.0, 1.0, 0.0, 0.0, 0.02, sd_rad, 1))
        return bool(seen.page.evaluate(PIXEL, [1.9, 1.25])[3])

    seen.until(lambda: sector(0.2), "the sector of its heading")
    seen.until(lambda: not sector(0.1), "a slimmer one")
    robot.late_s += 5.0
    seen.until(lambda: not pink(3.0, 1.0), "old echoes being gone")


def test_battery_speed_time_and_reception_stand_beside_the_map(robot: Robot, visit: Open) -> None:
    """0.2 m/s for 20 s, then 40 m from home."""
    robot.wall(0.0)
    carrier = CarrierReport(0.0, CarrierState.MOVING, 0, 0, 0, 0.2, 0, 0, True, False, 11.84)
    robot.feed.take(CARRIER, carrier)
    robot.feed.take(PLAN, PlannerView(0.0, "HOME", "driving home", np.array([[44.0, 1.0]], np.float32), 0, 40.0))
    steps = iter(range(100_000))

    def drive(count: int) -> None:
        for k in itertools.islice(steps, count):
            robot.feed.take(POSE, PoseEstimate(0.1 * k, 0.02 * k, 1.0, 0.0, 0.0, 0.02, 0.01, 1))

    drive(200)
    seen = visit(robot)
    shown = {name: seen.page.locator(f"#{name}") for name in ("battery", "speed-now", "left", "reception")}

    def until(name: str, text: str) -> None:
        def there() -> bool:
            drive(1)
            return re.fullmatch(text, shown[name].text_content() or "") is not None

        seen.until(there, f"{name} as {text}")

    until("left", "≈ 3 min")
    robot.feed.take(PLAN, view(halls_open=4))
    until("left", "[0-9]+ to [0-9]+ min")
    until("speed-now", r"0\.20 m/s")
    until("reception", "100 %")
    until("battery", r"11\.8 V")
    robot.feed.take(STATUS["bridge"], Status(0.0, "RUN", ErrorCode.BATTERY_LOW, 100, True, 1))
    until("battery", r"11\.8 V low")
    drive(1), next(steps), drive(1)  # one is lost
    until("reception", "9[0-9] %")


@pytest.mark.slow
def test_a_modules_last_ten_minutes_are_two_curves_and_words(robot: Robot, visit: Open) -> None:
    for k in range(61):
        robot.late_s += 10.1
        report = Status(0.0, "MAPPING", 0, 1024 * (100 + k), True, 1, cpu_share=0.05 if k < 30 else 0.09)
        robot.feed.take(STATUS["mmu"], report)
    robot.floor()
    seen = visit(robot)
    seen.page.locator("#modules summary").click()
    words = seen.page.get_by_text(re.compile(r"10\d to 159 MB, 5 to 9 % cpu in 10 min"))
    expect(words).to_be_visible()
    expect(words.locator("polyline")).to_have_count(2)


def view(**changes: Any) -> PlannerView:
    nowhere = np.zeros((0, 2), np.float32)
    return dataclasses.replace(PlannerView(0.0, "FOLLOW", "following a hall", nowhere, 3, 40.0), **changes)


KNOWN = "import('./main.js').then(({ model }) => model.alerts !== null)"
RUNG = "import('./main.js').then(() => window.rung ?? 0)"
COUNTED = "() => { window.rung = 0; AudioContext.prototype.resume = () => { window.rung++; }; }"


def test_the_end_is_called_in_the_pages_title_and_a_notice_with_no_sound_unless_it_is_switched_on(
    robot: Robot, visit: Open
) -> None:
    robot.floor()
    robot.feed.take(PLAN, view())
    seen = visit(robot)
    seen.page.evaluate(COUNTED)
    seen.until_live(robot)
    expect(seen.page).to_have_title("robot1 · Indoor Mapping")
    notice = seen.page.locator("#notice")
    expect(notice).to_be_hidden()
    robot.feed.take(PLAN, view(mode="DONE", outcome=Outcome.FINISHED))
    expect(seen.page).to_have_title("(!) The mission has ended: finished, and home.")
    expect(notice).to_have_text("The mission has ended: finished, and home.")
    assert seen.page.evaluate(RUNG) == 0
    seen.page.mouse.click(300, 300)
    expect(seen.page).to_have_title("robot1 · Indoor Mapping")
    expect(notice).to_be_visible()
    notice.get_by_role("button").click()
    expect(notice).to_be_hidden()
    seen.page.get_by_role("button", name="Sound").click()
    before = seen.page.evaluate(RUNG)
    robot.feed.take(STATUS["bridge"], Status(0.0, "RUN", ErrorCode.BATTERY_LOW, 100, True, 1))
    expect(notice).to_contain_text("the battery is low → charge the battery")
    assert seen.page.evaluate(RUNG) == before + 1
    later = visit(robot)
    later.until(lambda: robot.pose() or later.page.evaluate(KNOWN), "the state of the mission")
    expect(later.page).to_have_title("robot1 · Indoor Mapping")
    expect(later.page.locator("#notice")).to_be_hidden()  # what is so already calls nobody
