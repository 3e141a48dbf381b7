"""The page for people with keys, screen readers and tired eyes, as axe-core judges it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from playwright.sync_api import Page

from common.messages.mission import Outcome, PlannerView
from common.messages.topics import PLAN
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
    planned = PlannerView(0.0, "HOME", "driving home", np.zeros((0, 2), np.float32), 0, 40.0)
    robot.feed.take(PLAN, planned)
    seen = visit(robot, color_scheme=scheme, viewport={"width": width, "height": 900})
    page = seen.page
    seen.until_live(robot)
    seen.until(lambda: page.locator(".marker").count() == 4, "the points of interest")
    page.evaluate(AXE)
    robot.feed.take(PLAN, replace(planned, mode="DONE", outcome=Outcome.NEEDS_HELP))
    page.locator("#notice").wait_for()
    found = findings(page, "live, with a notice")
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


# Everything that a person can act on and see now, numbered; those of the timeline are marks of a slider that has keys
NUMBERED = """() => {
    const all = [...document.querySelectorAll("button, a[href], input, select, summary, [tabindex]")].filter(
        (found) => found.tabIndex >= 0 && !found.disabled && found.checkVisibility({ visibilityProperty: true }),
    );
    all.forEach((element, k) => (element.dataset.number = k));
    return all.map((element) => element.id || element.title || element.textContent.trim() || element.ariaLabel);
}"""


def test_the_keyboard_alone_reaches_everything(robot: Robot, visit: Open) -> None:
    robot.floor()
    robot.feed.take_operator(OperatorView("IDLE"))
    seen = visit(robot)
    page = seen.page
    seen.until_live(robot)
    seen.until(lambda: page.locator(".marker").count() == 3, "the points of interest")
    for summary in ("#modules summary", "#export summary"):
        page.locator(summary).press("Enter")
    named = page.evaluate(NUMBERED)
    reached = set()
    for _ in range(len(named) + 5):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.dataset.number"))
    assert [name for k, name in enumerate(named) if str(k) not in reached] == []
    assert len(named) > 35
    page.locator("#poi-list button").first.press("Enter")
    numbered = page.evaluate(NUMBERED.replace("document.query", 'document.getElementById("poi").query'))
    reached = set()
    for _ in range(len(numbered) + 2):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.dataset.number"))
    assert [name for k, name in enumerate(numbered) if str(k) not in reached] == []
