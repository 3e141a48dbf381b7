"""The page for people with keys, screen readers and tired eyes, as axe-core judges it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources

import pytest
from playwright.sync_api import Page

from offboard.operate.bus_operator import OperatorView
from tests.browser.conftest import Robot, Visit

pytest.importorskip("axe_playwright_python", reason="axe-core comes with the extra `dev`")
pytestmark = pytest.mark.timeout(120)

Open = Callable[..., Visit]

AXE = resources.files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
SERIOUS = ("serious", "critical")


def findings(page: Page, where: str) -> list[str]:
    """What is seriously wrong with the page as it stands."""
    result = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")
    return [
        f"{where}: {found['id']} at {[node['target'] for node in found['nodes']]}"
        for found in result["violations"]
        if found["impact"] in SERIOUS
    ]


@pytest.mark.parametrize("width", [1440, 1000, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_core_finds_nothing_serious(robot: Robot, visit: Open, scheme: str, width: int) -> None:
    robot.floor()
    robot.door(4, "104", "Office", "doubtful")
    robot.feed.take_operator(OperatorView("IDLE", "The planner took the home."))
    seen = visit(robot, color_scheme=scheme, viewport={"width": width, "height": 900})
    page = seen.page
    seen.until_live(robot)
    seen.until(lambda: page.locator(".marker").count() == 4, "the points of interest")
    page.evaluate(AXE)
    found = findings(page, "live")
    page.locator("#export summary").click()
    found += findings(page, "the list of exports")
    page.keyboard.press("Escape")
    page.locator("#modules summary").click()
    robot.feed.take_operator(OperatorView("LATCHED"))
    robot.late_s += 60.0
    seen.until_link("silent")
    found += findings(page, "old data, modules")
    page.locator("#poi-list button").first.click()
    found += findings(page, "a point of interest")
    page.keyboard.press("Escape")
    page.locator("#scale-bar").click()
    assert found + findings(page, "the screen's size") == []
