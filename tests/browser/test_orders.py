"""Orders from the page: whoever sees it may stop the robot, it alone may order more, and no other page may anything."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import pytest
from playwright.sync_api import expect

from common.messages.mission import Operation
from common.messages.points_of_interest import DoorStatements
from common.messages.topics import DOOR_NOTES, ZONES
from common.zones import Zone, ZoneKind, message_of
from offboard.operate.bus_operator import OperatorView
from offboard.operate.door_sender import OfDoor
from offboard.operate.operations import Order
from tests.browser.conftest import Robot, Visit

pytestmark = pytest.mark.timeout(60)

Open = Callable[..., Visit]


class Orders:
    """Takes down what was ordered."""

    def __init__(self) -> None:
        self.taken: list[tuple[Any, ...]] = []
        self.given: list[Order] = []
        self.noted: list[OfDoor] = []

    def open(self) -> None: ...

    def close(self) -> None: ...

    def stop(self) -> None:
        self.taken.append(("stop",))

    def release(self, epoch: int) -> None:
        self.taken.append(("release", epoch))

    def note_door(self, of_door: OfDoor) -> None:
        self.noted.append(of_door)

    def operate(self, order: Order) -> None:
        self.given.append(order)
        self.taken.append((order.operation.value, round(order.x_m, 2), round(order.y_m, 2)))


@pytest.fixture
def orders() -> Orders:
    return Orders()


@pytest.fixture
def robot(orders: Orders) -> Iterator[Robot]:
    made = Robot(operator=orders)
    made.feed.take_operator(OperatorView("IDLE"))
    made.floor()
    yield made
    made.server.close()


@pytest.mark.parametrize("how", ["click", "space", "in a dialog"])
def test_the_stop_is_one_click_or_key_away(robot: Robot, orders: Orders, visit: Open, how: str) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    if how == "space":
        seen.page.keyboard.press("Space")
    else:
        if how == "in a dialog":
            seen.page.get_by_role("button", name="Door 102 Laboratory").click()
        seen.page.locator("#poi .stop" if how == "in a dialog" else "header .stop").click()
    seen.until(lambda: orders.taken == [("stop",)], "the stop")
    seen.page.keyboard.press("Escape")
    robot.feed.take_operator(OperatorView("SENT"))
    expect(seen.page.locator("header .stop")).to_have_text("Stop sent")
    expect(seen.page.locator("#answer")).to_contain_text("use the button on the robot")
    robot.feed.take_operator(OperatorView("LATCHED"))
    expect(seen.page.locator("header .stop")).to_have_text("Stopped")


def test_the_mission_is_ordered_by_buttons_and_answered_in_words(robot: Robot, orders: Orders, visit: Open) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    for name in ("Start", "Pause", "Resume", "Home"):
        seen.page.get_by_role("button", name=name, exact=True).click()
    seen.until(lambda: len(orders.taken) == 4, "the orders")
    assert [name for name, *_ in orders.taken] == ["start", "pause", "resume", "home"]
    robot.feed.take_operator(OperatorView("IDLE", "The planner took the home."))
    expect(seen.page.locator("#answer")).to_have_text("The planner took the home.")


def test_a_click_on_the_floor_or_on_a_door_is_where_it_drives_to(robot: Robot, orders: Orders, visit: Open) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    page = seen.page
    page.get_by_role("button", name="Go to").click()
    stage = page.locator("#stage").bounding_box()
    assert stage is not None
    x, y = page.evaluate("import('./main.js').then(({ map }) => map.view.toScreen(4, 1.5))")
    page.mouse.click(stage["x"] + x, stage["y"] + y)
    seen.until(lambda: len(orders.taken) == 1, "the order")
    name, x_m, y_m = orders.taken[0]
    assert (name, x_m, y_m) == ("goto", pytest.approx(4.0, abs=0.02), pytest.approx(1.5, abs=0.02))
    expect(page.get_by_role("button", name="Go to")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Door 102 Laboratory").click()
    page.get_by_role("button", name="Drive there").click()
    seen.until(lambda: orders.taken[1:] == [("goto", 2.5, 0.0)], "the order to the door")


def test_lines_and_areas_are_drawn_by_clicks_shown_as_the_robot_reports_and_removed(
    robot: Robot, orders: Orders, visit: Open
) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    page = seen.page
    page.get_by_role("button", name="No-go area").click()
    stage = page.locator("#stage").bounding_box()
    assert stage is not None
    corners = [(3.0, 0.5), (5.0, 0.5), (5.0, 2.0)]
    for count, (x_m, y_m) in enumerate(corners):
        expect(page.locator("#answer")).to_contain_text(f"{count} so far")
        assert page.locator("#drawn").is_disabled()
        x, y = page.evaluate(f"import('./main.js').then(({{ map }}) => map.view.toScreen({x_m}, {y_m}))")
        page.mouse.click(stage["x"] + x, stage["y"] + y)
    page.get_by_role("button", name="Done", exact=True).click()
    seen.until(lambda: len(orders.given) == 1, "the order")
    (order,) = orders.given
    assert order.operation is Operation.NO_GO_AREA
    assert [pytest.approx(corner, abs=0.02) for corner in order.corners_m] == corners
    robot.feed.take(ZONES, message_of(0.0, (Zone(4, ZoneKind.AREA, order.corners_m),)))
    page.get_by_role("button", name="Remove no-go area 4").click()
    seen.until(lambda: orders.given[1:] == [Order(Operation.REMOVE_ZONE, zone=4)], "the order to remove it")
    page.get_by_role("button", name="No-go line").click()
    page.keyboard.press("Escape")
    expect(page.locator("#drawn")).to_be_hidden()
    assert len(orders.given) == 2


def test_a_stop_is_released_by_a_typed_word_and_only_the_one_that_was_shown(
    robot: Robot, orders: Orders, visit: Open
) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    page = seen.page
    form = page.locator("#release")
    expect(form).to_be_hidden()
    robot.feed.take_operator(OperatorView("LATCHED", epoch=7, latched="The button on the robot is pressed."))
    expect(form).to_contain_text("The button on the robot is pressed.")
    expect(form.get_by_role("button")).to_be_disabled()
    robot.feed.take_operator(OperatorView("LATCHED", epoch=7))
    expect(form.get_by_role("button")).to_be_enabled()
    form.get_by_role("textbox").fill("yes")
    form.get_by_role("textbox").press("Enter")
    expect(form).to_contain_text("the word is release")
    form.get_by_role("textbox").fill("Release")
    form.get_by_role("button").click()
    seen.until(lambda: orders.taken == [("release", 7)], "the release")
    robot.feed.take_operator(OperatorView("RELEASED", epoch=7))
    expect(form).to_be_hidden()


def test_a_door_is_put_right_and_named_in_its_dialog(robot: Robot, orders: Orders, visit: Open) -> None:
    seen = visit(robot)
    seen.until_live(robot)
    page = seen.page
    page.get_by_role("button", name="Door 102 Laboratory").click()
    expect(page.get_by_label("Number", exact=True)).to_have_value("102")
    page.get_by_label("Number", exact=True).fill("103")
    page.get_by_label("Room's name").fill("Green room")
    page.get_by_label("Room's name").press("Enter")
    seen.until(lambda: orders.noted == [OfDoor(2, 2.5, 0.0, "103", "Green room")], "what was said")
    robot.feed.take(DOOR_NOTES, DoorStatements(0.0, 1, (2,), (2.5,), (0.0,), ("103",), ("Green room",)))
    expect(page.locator("#poi-headline")).to_have_text("Green room 103")
    expect(page.locator('[data-field="state"]')).to_have_text("✓ Corrected by a person, read as 102")


FOREIGN = b"""<!doctype html><title>foreign</title><script>
const at = new URLSearchParams(location.search).get("robot");
window.tried = 0;
const socket = new WebSocket(at.replace("http", "ws") + "live");
socket.onopen = () => socket.send(JSON.stringify({ order: "stop" }));
socket.onclose = socket.onerror = () => window.tried++;
for (const path of ["", "live", "refusal", "stop", "order"])
  for (const method of ["GET", "POST"])
    fetch(at + path, { method, mode: "no-cors", body: method === "POST" ? '{"order":"stop"}' : undefined })
      .catch(() => {}).finally(() => window.tried++);
</script>"""


class _Foreign(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(FOREIGN)

    def log_message(self, *_: Any) -> None: ...


def test_a_foreign_page_in_the_same_browser_moves_and_stops_nothing(robot: Robot, orders: Orders, visit: Open) -> None:
    foreign = ThreadingHTTPServer(("127.0.0.1", 0), _Foreign)
    Thread(target=partial(foreign.serve_forever, 0.05), daemon=True).start()
    try:
        seen = visit(robot)
        seen.until_live(robot)
        other = visit(None, at=f"http://127.0.0.1:{foreign.server_port}/?robot={robot.server.address}")
        other.until(lambda: other.page.evaluate("window.tried") >= 11, "all that it tries")
        assert orders.taken == []
        other.page.close()
        other.errors.clear()  # what the browser says of what it tried
    finally:
        foreign.shutdown()
        foreign.server_close()


def test_a_recorded_or_robotless_page_has_no_orders(visit: Open) -> None:
    robot = Robot()
    robot.floor()
    try:
        seen = visit(robot)
        seen.until_live(robot)
        expect(seen.page.locator("header .stop")).to_be_hidden()
        expect(seen.page.locator("#orders")).to_be_hidden()
    finally:
        robot.server.close()
