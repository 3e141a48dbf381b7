"""The list of recorded runs in the browser, two of them over each other, and from a line of the log to its moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect

from offboard.runs import run_folder
from offboard.visualizer.run_library import RunLibrary
from offboard.visualizer.server import PageServer
from tests.browser.conftest import Visit
from tests.browser.test_accessible import AXE, findings
from tests.unit.test_run_library import record

pytestmark = pytest.mark.timeout(60)

Open = Callable[..., Visit]

# How many pixels of the lower canvas have the colour of that variable
COLOURED = """(name) => {
    const canvas = document.getElementById("base");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const colour = getComputedStyle(document.documentElement).getPropertyValue(name);
    const [r, g, b] = colour.match(/\\w\\w/g).map((hex) => parseInt(hex, 16));
    let count = 0;
    for (let k = 0; k < data.length; k += 4)
        if (Math.abs(data[k] - r) + Math.abs(data[k + 1] - g) + Math.abs(data[k + 2] - b) < 24) count++;
    return count;
}"""


@pytest.fixture
def library(tmp_path: Path) -> Iterator[PageServer]:
    """Monday's hall, and Tuesday's with a cupboard in it."""
    for name in ("monday", "tuesday"):
        record(tmp_path / name)
    walls_m, inferred = run_folder.read_map_points(tmp_path / "tuesday" / run_folder.MAP_POINTS_NAME)
    cupboard_m = np.column_stack([np.arange(3.0, 5.0, 0.1), np.full(20, 0.1)])
    everything = np.concatenate([walls_m, cupboard_m])
    run_folder.write_map_points(
        tmp_path / "tuesday" / run_folder.MAP_POINTS_NAME, everything, np.append(inferred, np.zeros(20, np.uint8))
    )
    made = PageServer(RunLibrary(tmp_path), "127.0.0.1", 0)
    made.start()
    yield made
    made.close()


def test_runs_are_listed_found_opened_and_compared(library: PageServer, visit: Open) -> None:
    seen = visit(None, at=library.address)
    page = seen.page
    cards = page.locator(".run")
    expect(cards).to_have_count(2)
    expect(cards.first).to_contain_text("finished, and home")
    expect(cards.first).to_contain_text("12:34 min")
    picture = cards.first.locator("img")
    seen.until(lambda: picture.evaluate("image => image.naturalWidth") == 480, "the thumbnail")
    page.evaluate(AXE)
    assert findings(page, "the list of runs") == []
    page.get_by_label("Search runs").fill("tues")
    expect(cards).to_have_count(1)
    page.get_by_label("Search runs").fill("")
    compare = page.locator("#compare")
    expect(compare).to_be_disabled()
    for name in ("monday", "tuesday"):
        page.get_by_label(f"Compare {name}").check()
    expect(compare).to_have_text("tuesday over monday")
    compare.click()
    expect(page).to_have_url(f"{library.address}over/monday/tuesday/")
    expect(page.locator("#over")).to_contain_text("tuesday over monday")
    expect(page.locator("#over")).to_contain_text("% of the walls that both saw agree")
    seen.until(lambda: page.evaluate(COLOURED, "--map-there") > 50, "the cupboard, in tuesday's colour")
    assert page.evaluate(COLOURED, "--map-here") < 10
    assert seen.wall_pixels() > 200, "what both have, in the colour of walls"
    page.go_back()
    page.get_by_role("link", name="monday").click()
    expect(page.locator("body")).to_have_attribute("data-link", "recorded")
    expect(page.locator("#over")).to_be_hidden()
