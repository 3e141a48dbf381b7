"""A run that is over on the page: the same map, doors and exports, and nothing that says live or lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from playwright.sync_api import expect

from common.config import VisualizerSection
from offboard.runs import run_folder
from offboard.visualizer.feed import Feed
from offboard.visualizer.live_model import ShownRun
from offboard.visualizer.run_view import feed_of_run, serve
from tests.browser.conftest import Robot, Visit, photo

pytestmark = pytest.mark.timeout(60)

Open = Callable[..., Visit]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A hall of two walls with two doors, driven along once."""
    folder = tmp_path / "monday"
    (folder / "photos").mkdir(parents=True)
    (folder / "photos" / "poi_1.jpg").write_bytes(photo())
    xs = np.arange(0.0, 8.0, 0.05)
    walls = np.concatenate([np.column_stack([xs, np.full(len(xs), y)]) for y in (-1.25, 1.25)])
    run_folder.write_map_points(folder / run_folder.MAP_POINTS_NAME, walls, np.zeros(len(walls), np.uint8))
    way = np.column_stack([np.linspace(0.0, 6.0, 61), np.zeros(61), np.zeros(61)])
    run_folder.write_tum(folder / run_folder.SMOOTHED_NAME, np.arange(61.0), way)
    door = {"poi_id": 1, "name": "Door", "number": "101", "room_type": "Office", "x_m": 2.0, "y_m": -1.25}
    door |= {"state": "read", "photo": "photos/poi_1.jpg", "confidence": 0.9}
    other = {"poi_id": 2, "name": "Door", "number": "102", "x_m": 5.0, "y_m": -1.25, "state": "doubtful"}
    run_folder.write_json(folder / run_folder.POIS_NAME, [door, other])
    return folder


class Served:
    """The page of a feed, served until it is closed."""

    def __init__(self, feed: Feed, port: int = 0, unwatched_s: float = float("inf")) -> None:
        self._stop, self._there = Event(), Event()
        self.address = ""
        arguments = feed, VisualizerSection(port=port), self._stop, self._has, unwatched_s
        self.thread = Thread(target=serve, args=arguments, daemon=True)
        self.thread.start()
        assert self._there.wait(10.0)

    def _has(self, address: str) -> None:
        self.address = address
        self._there.set()

    def close(self) -> None:
        self._stop.set()
        self.thread.join(10.0)


@pytest.fixture
def served(run: Path) -> Iterator[Served]:
    made = Served(feed_of_run(run))
    yield made
    made.close()


@pytest.mark.requirement("VSL_MR_04")
def test_a_finished_run_is_shown_with_its_map_doors_photos_and_exports(served: Served, visit: Open) -> None:
    seen = visit(None, at=served.address)
    seen.until_link("recorded")
    expect(seen.page.locator("#link")).to_contain_text("Recorded run")
    expect(seen.page.locator("#banner")).to_be_hidden()
    seen.until(lambda: seen.wall_pixels() > 200, "the walls")
    expect(seen.page.locator("#driven")).to_have_text("6.0 m")
    seen.page.get_by_role("button", name="Door 101 Office").click()
    image = seen.page.get_by_role("img", name="Photo of Office 101")
    seen.until(lambda: image.evaluate("image => image.naturalWidth") == 320, "the photo")
    seen.page.keyboard.press("Escape")
    seen.page.get_by_text("Export").click()
    with seen.page.expect_download() as download:
        seen.page.get_by_role("link", name="SVG").click()
    assert download.value.suggested_filename == "monday-map.svg"


def test_a_page_that_watched_the_run_shows_it_on_when_the_mesh_has_ended(run: Path, visit: Open) -> None:
    robot = Robot(run=ShownRun(str(run)))
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    robot.server.close()
    seen.until_link("ended")
    expect(seen.page.locator("#banner")).to_contain_text(f"To see the run again: indoor-mapping view {run}")
    served = Served(feed_of_run(run), robot.server.port, unwatched_s=4.0)
    try:
        seen.until_link("recorded")
        expect(seen.page.locator(".marker")).to_have_count(2)
        served.thread.join(4.5)
        assert served.thread.is_alive(), "it ended though a page was open"
        seen.page.close()
        served.thread.join(10.0)
        assert not served.thread.is_alive(), "it went on though nobody looked"
    finally:
        served.close()
