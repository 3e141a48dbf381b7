"""The page's server: what it gives to whom, and the node that feeds it."""

from __future__ import annotations

import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from common.bus import LocalMesh
from common.errors import StartError
from common.messages import GRID, MAP, POI, POSE, STATUS, GridUpdate, MapUpdate, PointOfInterest, PoseEstimate
from offboard.visualizer.feed import Feed
from offboard.visualizer.server import PageServer
from offboard.visualizer.visualizer import Visualizer


def until(condition: Callable[[], object], deadline_s: float = 5.0) -> None:
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


@pytest.fixture
def feed() -> Feed:
    feed = Feed()
    points = np.array([[0.0, 1.0], [2.0, 1.0]], np.float32)
    feed.take(MAP, MapUpdate(0.0, 1, 0, points, np.array([0, 1], np.uint8)))
    feed.take(POI, PointOfInterest(1.0, 7, "Door", "101", 1.0, 1.0, "101", "Office", 0.9, "read", b"\xff\xd8jpeg"))
    return feed


@pytest.fixture
def server(feed: Feed) -> Iterator[PageServer]:
    server = PageServer(feed, "127.0.0.1", 0, "robot7")
    server.start()
    yield server
    server.close()


def get(server: PageServer, path: str, **headers: str) -> tuple[int, Any, bytes]:
    request = urllib.request.Request(server.address + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=5) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


def live(server: PageServer, **options: Any) -> Any:
    return connect(server.address.replace("http", "ws") + "live", open_timeout=5, **options)


def test_the_page_comes_with_a_policy_that_lets_it_ask_nobody_else(server: PageServer) -> None:
    status, headers, body = get(server, "")
    assert status == 200
    assert b"<title>Indoor Mapping</title>" in body
    assert headers["Content-Security-Policy"].startswith("default-src 'self'")
    assert "http" not in headers["Content-Security-Policy"]


@pytest.mark.parametrize(("form", "begin"), [("svg", b"<svg "), ("png", b"\x89PNG"), ("csv", b"x_m,y_m,inferred\n")])
def test_the_present_map_is_exported(server: PageServer, form: str, begin: bytes) -> None:
    status, headers, body = get(server, f"export/map.{form}")
    assert (status, body[: len(begin)]) == (200, begin)
    assert f'filename="robot7-map.{form}"' in headers["Content-Disposition"]


def test_wall_points_are_exported_as_they_are(server: PageServer) -> None:
    assert get(server, "export/map.csv")[2].decode().split() == ["x_m,y_m,inferred", "0.000,1.000,0", "2.000,1.000,1"]


def test_an_unknown_export_says_which_there_are(server: PageServer) -> None:
    status, _, body = get(server, "export/map.dxf")
    assert (status, body.decode()) == (404, "No export as dxf; choose from svg, png, csv.")


def test_photos_are_given_by_number(server: PageServer) -> None:
    status, headers, body = get(server, "photos/7.jpg")
    assert (status, headers["Content-Type"], body) == (200, "image/jpeg", b"\xff\xd8jpeg")
    assert get(server, "photos/8.jpg")[0] == 404


def test_a_strange_name_for_this_machine_is_turned_away(server: PageServer) -> None:
    assert get(server, "", Host="evil.example")[0] == 400


def test_another_sites_page_may_not_listen(server: PageServer) -> None:
    with pytest.raises(InvalidStatus):
        live(server, origin="http://evil.example")


def test_a_page_is_told_at_once_and_then_what_is_new(server: PageServer, feed: Feed) -> None:
    with live(server) as page:
        first = [page.recv(timeout=5) for _ in range(3)]
        assert json.loads(first[0]) == {"channel": "hello", "robot": "robot7"}
        until(lambda: server.pages == 1)
        feed.take(POSE, PoseEstimate(0.0, 3.0, 0.0, 0.0, 0.0, 0.1, 0.1, 1))
        while True:
            message = page.recv(timeout=5)
            if isinstance(message, str) and json.loads(message)["channel"] == "pose":
                break
        assert json.loads(message)["x_m"] == 3.0
    until(lambda: server.pages == 0)


def test_heartbeats_come_while_nothing_else_does(server: PageServer) -> None:
    with live(server) as page:
        heard = [json.loads(m)["channel"] for m in (page.recv(timeout=5) for _ in range(8)) if isinstance(m, str)]
    assert heard.count("heartbeat") >= 3


def test_a_page_that_does_not_read_is_later_given_the_newest_and_no_queue(server: PageServer, feed: Feed) -> None:
    size, count = 300_000, 100
    with live(server, max_queue=1, max_size=None) as page:
        until(lambda: server.pages == 1)
        for k in range(1, count + 1):
            feed.take(GRID, GridUpdate(0.0, k, 0.0, 0.0, 0.05, 10, k, bytes(size)))
            time.sleep(0.002)
        got = []
        while not got or got[-1] < count:
            message = page.recv(timeout=5)
            if isinstance(message, bytes):
                head = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
                got += [head["columns"]] if head["channel"] == "grid" else []
    assert len(got) < count / 2


def test_closing_ends_the_server_while_pages_look(feed: Feed) -> None:
    server = PageServer(feed, "127.0.0.1", 0)
    server.start()
    with live(server) as page:
        page.recv(timeout=5)
        began_s = time.monotonic()
        server.close()
        assert time.monotonic() - began_s < 3.0
    assert not server.running


def test_a_taken_port_is_one_sentence(feed: Feed) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(StartError, match=r"set another \[visualizer\] port in robot.toml"):
            PageServer(feed, "127.0.0.1", other.getsockname()[1])


@pytest.mark.requirement("VSL_MR_05")
def test_the_node_reports_its_status_ten_times_a_second_and_feeds_the_page() -> None:
    mesh = LocalMesh()
    robot, bus = mesh.endpoint("robot"), mesh.endpoint("visualizer")
    feed = Feed()
    server = PageServer(feed, "127.0.0.1", 0)
    node = Visualizer(feed, server)
    try:
        node.step(bus, 0.0)
        robot.take(STATUS["visualizer"])
        robot.publish(MAP, MapUpdate(0.0, 1, 0, np.zeros((3, 2), np.float32), np.zeros(3, np.uint8)))
        for k in range(1, 41):
            node.step(bus, k * node.period_s)
        reports = robot.take(STATUS["visualizer"])
        assert 19 <= len(reports) <= 22
        assert all(report.ready and server.address in report.detail for report in reports)
        assert len(feed.map_data().points_m) == 3
    finally:
        node.close()


def test_the_node_ends_when_its_server_does() -> None:
    bus = LocalMesh().endpoint("visualizer")
    feed = Feed()
    server = PageServer(feed, "127.0.0.1", 0)
    node = Visualizer(feed, server)
    server.close()
    with pytest.raises(RuntimeError, match="server has ended"):
        node.step(bus, 0.0)
