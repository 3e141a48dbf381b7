"""A run that is over on the page: the same map, doors and exports, and nothing that says live or lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from common.codec import encode
from common.config import VisualizerSection
from common.geometry import Pose2
from common.messages.health import LogLine
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import LOG, MAP, POI, POSE, Topic
from common.recording import RecordedMessage
from deploy.cli import main
from offboard.runs import run_folder
from offboard.runs.run_schema import Delivery, RunDatabase
from offboard.visualizer.live_model import ShownRun
from offboard.visualizer.run_view import RecordedRun, recorded_run, serve
from tests.browser.conftest import Robot, Visit, photo
from tests.unit.range_log_scenes import PERIOD_S, ROUND, carmen_lines, drive

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
    """The page of a run, served until it is closed."""

    def __init__(self, run: RecordedRun, port: int = 0, unwatched_s: float = float("inf")) -> None:
        self._stop, self._there = Event(), Event()
        self.address = ""
        arguments = run, VisualizerSection(port=port), self._stop, self._has, unwatched_s
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
    made = Served(recorded_run(run))
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
    served = Served(recorded_run(run), robot.server.port, unwatched_s=4.0)
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


@pytest.fixture
def played(run: Path) -> Iterator[Served]:
    """The same run with its database: 20 s along the hall, a door on the way, the wall seen after 10 s."""
    database = RunDatabase(run / run_folder.DATABASE_NAME, None, 1)
    for k in range(201):
        t_s = k / 10.0
        payloads: list[tuple[Topic[Any], Any]] = [(POSE, PoseEstimate(t_s, 0.3 * t_s, 0.0, 0.0, 0.0, 0.01, 0.01, 1))]
        if k in (20, 100):
            xs = np.arange(0.0, 4.0, 0.1) + (4.0 if k == 100 else 0.0)
            points = np.column_stack([xs, np.full(len(xs), -1.25)]).astype(np.float32)
            payloads.append((MAP, MapUpdate(t_s, 1, 0 if k == 20 else 40, points, np.zeros(len(xs), np.uint8))))
        if k == 60:
            payloads.append((POI, PointOfInterest(t_s, 1, "Door", "101", 2.0, -1.25, "101", "Office", 0.9, "read")))
        if k in (30, 150):
            text = "a wheel slipped" if k == 30 else "a door was found"
            payloads.append((LOG["mmu"], LogLine(t_s, "WARNING" if k == 30 else "INFO", text)))
        messages = [RecordedMessage(topic.key, 7, k + 1, encode(payload, k + 1, 7)) for topic, payload in payloads]
        database.store_data(Delivery(100.0 + t_s, messages))
    database.close()
    made = Served(recorded_run(run))
    yield made
    made.close()


SHOWN = "import('./main.js').then(({ model }) => [model.pose.x_m, model.pose.y_m, model.walls.length])"
POSITION = "import('./main.js').then(({ model }) => [model.pose.x_m, model.walls.length, model.pois.length])"


def test_a_recorded_run_is_played_from_any_moment_on(played: Served, visit: Open) -> None:
    seen = visit(None, at=played.address)
    seen.until_link("recorded")
    page = seen.page
    expect(page.locator("#clock")).to_have_text("0:20 / 0:20")
    page.get_by_role("button", name="Door 101").last.wait_for(state="attached")

    def at(seconds: float, *, points: int, doors: int) -> None:
        page.get_by_label("Moment of the run").fill(str(seconds))
        shown = [pytest.approx(0.3 * seconds, abs=0.05), points, doors]
        seen.until(lambda: page.evaluate(POSITION) == shown, f"the moment {seconds} s")
        expect(page.locator("#clock")).to_have_text(f"0:{int(seconds):02} / 0:20")

    at(1.0, points=0, doors=0)
    at(5.0, points=40, doors=0)
    at(15.0, points=80, doors=1)
    at(3.0, points=40, doors=0)
    page.get_by_label("Speed").select_option("30")
    page.get_by_role("button", name="Play").click()
    seen.until(lambda: page.evaluate(POSITION)[1] == 80, "the second wall")
    expect(page.locator("#clock")).to_have_text("0:20 / 0:20")
    expect(page.get_by_role("button", name="Play")).to_be_visible()


def test_a_carmen_log_is_played_on_the_page_as_it_was_mapped(tmp_path: Path, visit: Open) -> None:
    """A drive round a block: with each leg there are more walls, and the robot stands where the log has it."""
    log, frames = tmp_path / "ring.log", drive(ROUND)
    log.write_text("\n".join(carmen_lines("ROBOTLASER1", silent="2.5", legs=ROUND)), encoding="utf-8")
    assert main(["replay", str(log), "--out", str(tmp_path / "run")]) == 0
    served = Served(recorded_run(tmp_path / "run"))
    try:
        seen = visit(None, at=served.address)
        seen.until_link("recorded")
        expect(seen.page.locator("#clock")).to_have_text("1:08 / 1:08")

        def shown(frame: int, walls: tuple[int, int]) -> bool:
            """The robot near its place in the log, and so many wall points."""
            x_m, y_m, count = seen.page.evaluate(SHOWN)
            return frames[frame].distance_m(Pose2(x_m, y_m, 0.0)) < 0.2 and walls[0] <= count < walls[1]

        for frame, walls in ((0, (0, 1)), (40, (1, 160)), (80, (160, 280)), (120, (280, 400))):
            seen.page.get_by_label("Moment of the run").fill(str(frame * PERIOD_S))
            seen.until(lambda at=frame, n=walls: shown(at, n), f"frame {frame}")  # type: ignore[misc]
        assert seen.wall_pixels() > 200
    finally:
        served.close()


def test_a_line_of_the_log_leads_to_its_moment(played: Served, visit: Open) -> None:
    seen = visit(None, at=played.address)
    seen.until_link("recorded")
    page = seen.page
    page.locator("#log summary").click()
    lines = page.locator("#log-list button")
    expect(lines).to_have_count(2)
    page.get_by_label("Level", exact=True).select_option("serious")
    expect(lines).to_have_count(1)
    page.get_by_label("Level", exact=True).select_option("")
    page.get_by_label("Search the log").fill("door found")
    expect(lines).to_have_text("0:15mmu a door was found")
    page.get_by_label("Search the log").fill("")
    lines.first.click()
    shown = [pytest.approx(0.9, abs=0.05), 40, 0]
    seen.until(lambda: page.evaluate(POSITION) == shown, "the moment of the slip")
    expect(lines.first).to_have_attribute("aria-current", "true")
