"""The page as a person sees it."""

from __future__ import annotations

import dataclasses
import re
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import WebSocketRoute, expect

from common.grid_cells import FREE, WALL
from common.messages.mapping import GridUpdate
from common.messages.mission import Outcome, PlannerView
from common.messages.topics import GRID, PLAN
from tests.browser.conftest import Robot, Visit

pytestmark = pytest.mark.timeout(60)

Open = Callable[..., Visit]


@pytest.mark.requirement("VSL_MR_04")
def test_the_map_is_drawn_and_grows(robot: Robot, visit: Open) -> None:
    robot.wall(0.0)
    robot.pose()
    seen = visit(robot)
    seen.until(lambda: seen.wall_pixels() > 200, "a wall on the map")
    before = seen.wall_pixels()
    robot.wall(2.5)
    seen.until(lambda: seen.wall_pixels() > 1.5 * before, "the second wall")


FLOOR = """([x, y]) => import('./main.js').then(({ map }) => {
    const [sx, sy] = map.view.toScreen(x, y).map((s) => s * map.ratio);
    return map.base.getContext("2d").getImageData(sx, sy, 1, 1).data[0];
})"""


def test_a_sonars_fan_through_a_wall_is_fainter_than_the_floor(robot: Robot, visit: Open) -> None:
    """A hall between two walls of points; beyond one of them floor that only a fan has shown."""
    cells = np.zeros((60, 100), np.uint8)
    cells[10:30, 5:95] = FREE
    cells[33:45, 40:60] = FREE
    cells[28:33, 45:55] = FREE
    cells[30, 5:95:2] = WALL
    cells[9, 5:95] = WALL
    grid = GridUpdate(0.0, 1, -0.5, -1.0, 0.05, 60, 100, zlib.compress(cells.tobytes()))
    robot.feed.take(GRID, grid)
    for k in range(30):
        robot.pose(x_m=k / 10, y_m=0.0)
    robot.pose(x_m=0.0, y_m=0.0)
    seen = visit(robot)
    seen.until_live(robot)
    hall, beyond, unknown = [2.6, 0.2], [2.2, 0.9], [0.3, 1.6]
    seen.until(lambda: seen.page.evaluate(FLOOR, hall) > seen.page.evaluate(FLOOR, beyond) + 10, "the floor")
    assert seen.page.evaluate(FLOOR, beyond) > seen.page.evaluate(FLOOR, unknown) + 2


WALL_SHARE = """(y) => import('./main.js').then(({ map }) => {
    const { view, ratio, base } = map;
    const context = base.getContext("2d");
    const [[x0, at], [x1]] = [view.toScreen(1, y), view.toScreen(7, y)];
    const { data } = context.getImageData(x0 * ratio, at * ratio, (x1 - x0) * ratio, 1);
    let dark = 0;
    for (let k = 0; k < data.length; k += 4) dark += data[k] < 0xb0;
    return dark / (data.length / 4);
})"""


def test_an_inferred_wall_is_dashed_and_one_that_was_echoed_is_not(robot: Robot, visit: Open) -> None:
    robot.wall(0.0)
    robot.wall(2.5, inferred=True)
    robot.pose()
    seen = visit(robot)
    seen.until_live(robot)
    seen.until(lambda: seen.page.evaluate(WALL_SHARE, 0.0) > 0.99, "the echoed wall without a gap")
    assert 0.3 < seen.page.evaluate(WALL_SHARE, 2.5) < 0.8


@pytest.mark.requirement("VSL_MR_04")
@pytest.mark.parametrize("how", ["mouse", "keyboard", "touch"])
def test_an_asterisk_opens_name_number_room_and_photo(robot: Robot, visit: Open, how: str) -> None:
    robot.floor()
    seen = visit(robot, has_touch=how == "touch")
    asterisk = seen.page.get_by_role("button", name="Door 101 Office")
    if how == "mouse":
        asterisk.click()
    elif how == "touch":
        asterisk.tap()
    else:
        asterisk.press("Enter")
    dialog = seen.page.get_by_role("dialog")
    expect(dialog).to_be_visible()
    assert dialog.locator("[data-field]").all_inner_texts()[:3] == ["Door", "101", "Office"]
    photo = dialog.get_by_role("img", name="Photo of Office 101")
    expect(photo).to_be_visible()
    seen.until(lambda: photo.evaluate("image => image.naturalWidth") == 320, "the photo")
    seen.page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    seen.until(lambda: seen.page.evaluate("location.hash") == "", "the address without it")


def test_the_mission_has_the_words_that_the_terminal_shows(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    mission, motion = seen.page.locator("#mission-state"), seen.page.locator("#permit")
    step = seen.page.locator("#phases [aria-current=step]")

    def planned(**changes: Any) -> None:
        nowhere = np.zeros((0, 2), np.float32)
        view = PlannerView(0.0, "ROUTE", "driving to a side hall", nowhere, 3, 40.0)
        robot.feed.take(PLAN, dataclasses.replace(view, **changes))
        seen.until_live(robot)

    planned()
    expect(mission).to_have_text("Driving to a side hall")
    expect(motion).to_have_text("May move")
    expect(step).to_have_text("Explore")
    planned(paused=True)
    expect(mission).to_have_text("Paused while driving to a side hall")
    expect(motion).to_have_text("Stands still: paused")
    planned(mode="DONE", detail="arrived at the place", outcome=Outcome.ARRIVED)
    expect(mission).to_have_text("Arrived at the place")
    expect(seen.page.locator("#halls")).to_have_text("3 not visited")
    expect(step).to_have_count(0)
    expect(seen.page.locator("#phases .past")).to_have_count(0)


def test_the_page_asks_nobody_but_its_own_server(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    seen.page.get_by_role("button", name="Door 102 Laboratory").click()
    expect(seen.page.get_by_role("img", name="Photo of")).to_be_visible()
    seen.until(lambda: any("photos/2.jpg" in address for address in seen.asked), "the photo being asked for")
    hosts = {re.sub(r"^\w+://([^/]+)/.*", r"\1", address) for address in seen.asked if ":" in address[:6]}
    assert hosts == {f"127.0.0.1:{robot.server.port}"}


def test_old_data_are_marked_stale_and_the_map_turns_grey(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    alert = seen.page.locator("#banner")
    robot.late_s += 60.0
    seen.until_link("silent")
    expect(alert).to_contain_text(
        re.compile(r"STALE: nothing from the robot for 6\d s\. Last known position and map, 6\d s old\.")
    )
    assert "grayscale" in seen.page.locator("#base").evaluate("canvas => getComputedStyle(canvas).filter")
    expect(seen.page.locator("#position")).to_contain_text(re.compile(r"6\d s ago"))
    seen.until_live(robot)
    expect(alert).to_be_hidden()


def test_a_server_that_falls_silent_is_noticed_though_its_socket_is_open(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    sockets: list[WebSocketRoute] = []
    frozen = False

    def freezable(socket: WebSocketRoute) -> None:
        sockets.append(socket)
        server = socket.connect_to_server()
        server.on_message(lambda message: None if frozen else socket.send(message))

    seen.page.route_web_socket(re.compile(r"/live\?"), freezable)
    seen.page.reload()
    seen.until_live(robot)
    frozen = True
    seen.until_link("stale", "silent")
    assert len(sockets) == 1


def test_a_restarted_server_fills_the_page_again(visit: Open) -> None:
    first = Robot()
    first.wall(0.0)
    first.pose()
    seen = visit(first)
    seen.until_live(first)
    first.server.close()
    seen.until_link("ended", "lost")
    expect(seen.page.locator("#banner")).to_contain_text("Last known position")
    second = Robot(first.server.port)
    try:
        second.floor()
        seen.until(lambda: seen.page.locator(".marker").count() == 3, "the points of interest")
        seen.until_live(second)
        seen.until(lambda: seen.wall_pixels() > 200, "the map")
    finally:
        second.server.close()


def test_a_reloaded_page_fills_itself_again(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until(lambda: seen.wall_pixels() > 200, "the map")
    seen.page.reload()
    seen.until(lambda: seen.wall_pixels() > 200, "the map")
    expect(seen.page.locator(".marker")).to_have_count(3)


def test_an_address_opens_its_point_of_interest_also_when_that_is_found_later(robot: Robot, visit: Open) -> None:
    robot.wall(0.0)
    seen = visit(robot, "#poi=9")
    seen.until_live(robot)
    expect(seen.page.get_by_role("dialog")).to_be_hidden()
    robot.door(9, "209", "Kitchen")
    expect(seen.page.get_by_role("dialog")).to_contain_text("Kitchen 209")
    expect(seen.page.get_by_role("dialog")).to_contain_text("No photo of it yet.")


def test_the_list_is_searched_filtered_and_opened_by_keys(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    rows = seen.page.locator("#poi-list button")
    expect(rows).to_have_count(3)
    seen.page.keyboard.press("/")
    seen.page.keyboard.type("labor 10")
    expect(rows).to_have_count(1)
    expect(seen.page.locator("#poi-count")).to_have_text("1 of 3")
    seen.page.keyboard.press("ArrowDown")
    seen.page.keyboard.press("Enter")
    expect(seen.page.get_by_role("dialog")).to_contain_text("Laboratory 102")
    seen.page.keyboard.press("Escape")
    seen.page.locator("#search").press("Escape")
    seen.page.get_by_role("button", name="To check").click()
    expect(rows).to_have_count(1)
    expect(rows).to_have_accessible_name("Door, Not readable")


def test_a_new_point_of_interest_does_not_take_the_focus_away(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    row = seen.page.locator('#poi-list [data-poi="2"]')
    row.focus()
    robot.door(4, "100")
    expect(seen.page.locator("#poi-list button")).to_have_count(4)
    expect(row).to_be_focused()


@pytest.mark.requirement("VSL_MR_04")
def test_one_centimetre_on_the_screen_is_one_metre(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    seen.page.keyboard.press("1")
    expect(seen.page.locator("#scale-bar")).to_contain_text("1 : 100")
    boxes = [seen.page.locator(f'.marker[data-poi="{k}"]').bounding_box() for k in (1, 2)]
    assert all(box is not None for box in boxes)
    apart_px = abs(_middle(boxes[1]) - _middle(boxes[0]))
    assert apart_px == pytest.approx(96 / 2.54, abs=0.3)


def _middle(box: Any) -> float:
    return float(box["x"] + box["width"] / 2)


def test_the_view_zooms_moves_turns_and_measures(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    page = seen.page
    seen.until(lambda: page.locator(".marker").count() == 3, "the points of interest")

    def apart() -> tuple[float, float]:
        one, two = (page.locator(f'.marker[data-poi="{k}"]').bounding_box() for k in (1, 2))
        assert one is not None
        assert two is not None
        return two["x"] - one["x"], two["y"] - one["y"]

    before = apart()
    page.mouse.move(400, 300)
    page.mouse.wheel(0, -300)
    seen.until(lambda: apart()[0] > 1.2 * before[0], "the map being larger")
    page.keyboard.press("0")
    seen.until(lambda: apart()[0] == pytest.approx(before[0], abs=1), "everything being shown")
    page.keyboard.press("[")
    seen.until(lambda: apart()[1] < -5, "the map being turned to the left")
    page.keyboard.press("r")
    page.mouse.down()
    page.mouse.move(600, 300)
    page.mouse.up()
    expect(page.get_by_title("Measure")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("Escape")
    expect(page.get_by_title("Measure")).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("f")
    expect(page.get_by_title("Follow the robot")).to_have_attribute("aria-pressed", "true")


def test_the_ruler_begins_at_an_asterisk_too_and_letters_work_with_shift(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    page = seen.page
    middles = [page.locator(f'.marker[data-poi="{k}"]').bounding_box() for k in (1, 3)]
    page.keyboard.press("Shift+R")
    expect(page.get_by_title("Measure")).to_have_attribute("aria-pressed", "true")
    for box, act in zip(middles, (page.mouse.down, page.mouse.up), strict=True):
        assert box is not None
        page.mouse.move(_middle(box) + 2, box["y"] + box["height"] / 2 - 2)
        act()
    expect(page.get_by_role("dialog")).to_be_hidden()
    measured = page.evaluate("import('./main.js').then(({ map }) => map.measured)")
    assert measured == {"from": [1.5, 0.0], "to": [3.5, 0.0]}, "from door to door, to the millimetre"
    page.keyboard.press("Shift+F")
    expect(page.get_by_title("Follow the robot")).to_have_attribute("aria-pressed", "true")


def test_a_place_keeps_its_coordinates_while_the_map_grows_and_they_are_those_of_goto(
    robot: Robot, visit: Open
) -> None:
    robot.floor()
    seen = visit(robot)
    seen.until_live(robot)
    place = seen.page.locator('[data-field="place"]')
    seen.page.get_by_role("button", name="Door 101 Office").click()
    expect(place).to_have_text("1.50, 0.00 m from the start")
    robot.wall(-30.0, 60.0)
    seen.until(lambda: robot.pose() or seen.page.evaluate(BOTTOM) == -30.0, "the map having grown")
    expect(place).to_have_text("1.50, 0.00 m from the start")
    expect(seen.page.locator("#position")).to_have_text("1.00, 1.00 m")


BOTTOM = "import('./main.js').then(({ model }) => model.walls.box[1])"


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(robot: Robot, visit: Open, width: int) -> None:
    robot.floor()
    seen = visit(robot, viewport={"width": width, "height": 800})
    seen.until_live(robot)
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_map_can_be_taken_away_as_a_file(robot: Robot, visit: Open) -> None:
    robot.floor()
    seen = visit(robot)
    seen.page.get_by_text("Export").click()
    with seen.page.expect_download() as download:
        seen.page.get_by_role("link", name="SVG").click()
    assert download.value.suggested_filename == "robot1-map.svg"
    assert download.value.path().read_text(encoding="utf-8").startswith("<svg ")
