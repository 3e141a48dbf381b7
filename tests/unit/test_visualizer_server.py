"""The page's server: what it gives to whom, and the node that feeds it."""

from __future__ import annotations

import logging
import socket
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from common.bus import LocalMesh
from common.errors import StartError
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import GRID, MAP, POI, POSE, STATUS
from offboard.export import map_picture
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import MapData
from offboard.visualizer import connections, open_pages
from offboard.visualizer.feed import Feed
from offboard.visualizer.feed_site import FeedSite
from offboard.visualizer.server import PageServer
from offboard.visualizer.visualizer import Visualizer
from tests.page_socket import PageSocket, page_socket


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
    server = PageServer(FeedSite(feed, "robot7"), "127.0.0.1", 0)
    server.start()
    yield server
    server.close()


def served(feed: Feed, host: str = "127.0.0.1", robot: str = "robot7", names: Sequence[str] = ()) -> PageServer:
    server = PageServer(FeedSite(feed, robot), host, 0, names)
    server.start()
    return server


def get(server: PageServer, path: str, **headers: str) -> tuple[int, Any, bytes]:
    request = urllib.request.Request(server.address + path, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=5) as answer:
            return answer.status, answer.headers, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read()


def live(server: PageServer, held: str = "", **options: Any) -> AbstractContextManager[PageSocket]:
    return page_socket(server.address, held, **options)


def raw(server: PageServer, **options: Any) -> ClientConnection:
    """The socket of somebody who confirms nothing."""
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
    status, _, body = get(server, "export/map.dwg")
    assert (status, body.decode()) == (404, "No export as dwg; choose from pdf, svg, png, dxf, geojson, csv.")


def test_photos_are_given_by_number(server: PageServer) -> None:
    status, headers, body = get(server, "photos/7.jpg")
    assert (status, headers["Content-Type"], body) == (200, "image/jpeg", b"\xff\xd8jpeg")
    assert get(server, "photos/8.jpg")[0] == 404


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_a_strange_name_for_this_machine_is_turned_away_wherever_the_page_is_served(feed: Feed, host: str) -> None:
    """A page of the internet that gives its own name this machine's address reads nothing, and may not listen."""
    with closing(served(feed, host, "robot7", ("floor3.example.org",))) as server:
        for name in (
            "evil.example",
            "evil.example:8080",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "",
            "[::1",
        ):
            assert get(server, "", Host=name)[0] == 400, name
        with pytest.raises(InvalidStatus):
            raw(server, origin="http://evil.example", additional_headers={"Host": "evil.example"})
        own = ("localhost", "127.0.0.1:8080", "10.0.0.7", "[::1]:80", socket.gethostname(), "floor3.example.org:8080")
        for name in own:
            assert get(server, "", Host=name)[0] == 200, name


def test_a_robots_name_of_any_letters_is_the_name_of_its_export(feed: Feed) -> None:
    with closing(served(feed, "127.0.0.1", '機器人"7')) as server:
        status, headers, _ = get(server, "export/map.csv")
    assert status == 200
    plain, coded = headers["Content-Disposition"].removeprefix("attachment; ").split("; ")
    assert plain == 'filename="____7-map.csv"'
    assert urllib.parse.unquote(coded.removeprefix("filename*=UTF-8''")) == '機器人"7-map.csv'


PATHS = ["photos/" + 5000 * "9" + ".jpg", "photos/-1.jpg", "photos/%D9%A3.jpg", "photos/7.0.jpg", "photos/%00.jpg"]
PATHS += [
    "export/map." + 5000 * "p",
    "export/map.%FF",
    "export/map.csv%0A",
    "%00",
    "%FF%FE",
    5000 * "a",
    "..%2f..%2fetc",
]


def test_a_path_that_leads_nowhere_is_404_and_leaves_no_word_in_the_log(
    server: PageServer, caplog: pytest.LogCaptureFixture
) -> None:
    for path in PATHS:
        assert get(server, path)[0] == 404
        assert get(server, path + "?" + 1000 * "x=%00&")[0] == 404
    assert not caplog.records


def test_exports_are_made_one_at_a_time_and_who_waited_gets_the_same(
    server: PageServer, feed: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[MapData] = []
    alone = threading.Lock()

    def draw(data: MapData, _: TitleBlock) -> bytes:
        assert alone.acquire(blocking=False)
        begun.append(data)
        time.sleep(0.1)
        alone.release()
        return b"\x89PNG"

    monkeypatch.setattr(map_picture, "as_png", draw)
    with ThreadPoolExecutor(16) as browsers:
        answers = list(browsers.map(lambda _: get(server, "export/map.png"), range(16)))
    assert {(status, body) for status, _, body in answers} == {(200, b"\x89PNG")}
    assert len(begun) == 1
    monkeypatch.setattr("offboard.visualizer.exports.KEPT_S", 0.0)
    get(server, "export/map.png")
    assert len(begun) == 1
    feed.take(MAP, MapUpdate(0.0, 1, 2, np.ones((1, 2), np.float32), np.zeros(1, np.uint8)))
    get(server, "export/map.png")
    assert len(begun) == 2


def test_what_is_said_to_lie_on_no_floor_is_left_out_of_the_exports(server: PageServer, feed: Feed) -> None:
    far = np.array([[1e7, 0.0], [0.0, -1e30], [np.nan, 0.0]], np.float32)
    feed.take(MAP, MapUpdate(0.0, 1, 2, far, np.zeros(3, np.uint8)))
    feed.take(POI, PointOfInterest(1.0, 8, "Door", "", 1e7, 1.0, "", "", 0.9, "read"))
    feed.take(POSE, PoseEstimate(0.0, 1e7, 0.0, 0.0, 0.0, 0.1, 0.1, 1))
    assert len(get(server, "export/map.csv")[2].split()) == 3
    for form in ("svg", "png"):
        assert len(get(server, f"export/map.{form}")[2]) < 80_000


def silent(server: PageServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=5.0)


def test_connections_that_say_nothing_make_way_for_who_asks(
    feed: Feed, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 8)
    with closing(served(feed)) as server, live(server) as page, ExitStack() as sockets:
        idle = [sockets.enter_context(silent(server)) for _ in range(50)]
        assert get(server, "")[0] == 200
        assert idle[0].recv(1) == b""
        page.next(5.0)
        assert len(server._server.server_state.connections) <= 8
    assert not caplog.records


BEGINNINGS = [b"", b"GET / HTTP/1.1\r\nX: ", b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 999\r\n\r\n"]


@pytest.mark.parametrize("beginning", BEGINNINGS, ids=["nothing", "headers", "body"])
def test_a_request_that_never_ends_is_given_up(feed: Feed, monkeypatch: pytest.MonkeyPatch, beginning: bytes) -> None:
    monkeypatch.setattr(connections, "PROGRESS_TIMEOUT_S", 0.2)
    with closing(served(feed)) as server, silent(server) as slow:
        slow.sendall(beginning)

        def ended() -> bool:
            try:
                slow.send(b"x" if beginning else b"")
                slow.settimeout(0.01)
                return slow.recv(1000) == b""
            except TimeoutError:
                return False
            except OSError:
                return True

        until(ended)


def test_a_reader_that_never_reads_is_given_up(feed: Feed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "PROGRESS_TIMEOUT_S", 0.2)
    feed.take(POI, PointOfInterest(1.0, 9, "Door", "", 1.0, 1.0, "", "", 0.9, "read", bytes(20_000_000)))
    with closing(served(feed)) as server, silent(server) as lazy:
        lazy.sendall(b"GET /photos/9.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n")
        state = server._server.server_state
        until(lambda: state.tasks)
        waiting = [connection.transport.get_write_buffer_size() for connection in state.connections]
        assert sum(waiting) < 1_000_000
        until(lambda: not state.connections and not state.tasks)


def test_no_more_pages_than_may_be_look_at_a_time(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_pages, "PAGES_MAX", 1)
    with live(server) as page:
        page.next(5.0)
        with pytest.raises(InvalidStatus):
            raw(server)
        assert get(server, "")[0] == 200
        assert get(server, f"refusal?origin={server.address.rstrip('/')}")[2].startswith(b"1 pages are open")
    until(lambda: server.pages == 0)
    with live(server) as page:
        page.next(5.0)


def test_a_page_that_says_anything_but_what_it_received_is_closed(server: PageServer) -> None:
    for message in (bytes(100_000), "x", '{"received": 99999999, "at": 0}', '{"received": 0}', "[" * 1000):
        with raw(server) as page:
            page.send(message)
            with pytest.raises(ConnectionClosed):
                list(page)


def test_a_flood_of_what_is_no_request_is_a_line_a_second_in_the_log(
    server: PageServer, caplog: pytest.LogCaptureFixture
) -> None:
    began_s = time.monotonic()
    for _ in range(100):
        with silent(server) as stranger:
            stranger.sendall(b"\x16\x03\x01 no request\r\n\r\n")
            assert b"400" in stranger.recv(100)
    assert 1 <= len(caplog.records) <= 2 + time.monotonic() - began_s


def test_a_fault_of_the_server_is_one_line_and_no_traceback(
    server: PageServer, feed: Feed, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(feed, "photo", lambda _: 1 / 0)
    with caplog.at_level(logging.INFO):
        assert [get(server, "photos/7.jpg")[0] for _ in range(5)] == [500] * 5
    (record,) = caplog.records
    assert record.getMessage() == "Exception in ASGI application error=ZeroDivisionError('division by zero') count=1"
    assert record.exc_info is None


def test_another_sites_page_may_not_listen(server: PageServer) -> None:
    with pytest.raises(InvalidStatus):
        raw(server, origin="http://evil.example")


def test_a_page_behind_a_proxy_that_changes_the_host_reads_why_it_is_refused(server: PageServer) -> None:
    proxied, own = "http://floor3.example.org", server.address.rstrip("/")
    with pytest.raises(InvalidStatus):
        raw(server, origin=proxied)
    status, _, sentence = get(server, f"refusal?origin={proxied}")
    assert (status, b"a proxy between them changes the Host header" in sentence) == (200, True)
    assert get(server, f"refusal?origin={own}")[2] == b""


def test_a_page_is_told_at_once_and_then_what_is_new(server: PageServer, feed: Feed) -> None:
    with live(server) as page:
        hello, _ = page.next(5.0)
        assert (hello["channel"], hello["robot"]) == ("hello", "robot7")
        assert [offer["form"] for offer in hello["exports"]] == ["pdf", "svg", "png", "dxf", "geojson", "csv"]
        until(lambda: server.pages == 1)
        feed.take(POSE, PoseEstimate(0.0, 3.0, 0.0, 0.0, 0.0, 0.1, 0.1, 1))
        assert page.of_channel("pose")[0]["x_m"] == 3.0
    until(lambda: server.pages == 0)


def test_a_page_that_lost_its_connection_goes_on_with_the_map_where_it_was(server: PageServer, feed: Feed) -> None:
    with live(server) as page:
        model = page.of_channel("hello")[0]["model"]
        whole, _ = page.of_channel("map")
    assert (whole["start"], whole["count"]) == (0, 2)
    feed.take(MAP, MapUpdate(0.0, 1, 2, np.ones((3, 2), np.float32), np.zeros(3, np.uint8)))
    with live(server, f"{model},{whole['epoch']},2") as page:
        rest, _ = page.of_channel("map")
    assert (rest["start"], rest["count"], rest["total"]) == (2, 3, 5)


def test_heartbeats_come_while_nothing_else_does(server: PageServer) -> None:
    with live(server) as page:
        began_s = time.monotonic()
        for _ in range(5):
            page.of_channel("heartbeat")
    assert 0.5 < time.monotonic() - began_s < 3.0


def test_a_page_that_does_not_read_is_later_given_the_newest_and_no_queue(server: PageServer, feed: Feed) -> None:
    size, count = 300_000, 100
    with live(server, max_queue=1) as page:
        until(lambda: server.pages == 1)
        for k in range(1, count + 1):
            feed.take(GRID, GridUpdate(0.0, k, 0.0, 0.0, 0.05, 10, k, bytes(size)))
            time.sleep(0.002)
        got: list[int] = []
        while not got or got[-1] < count:
            got.append(page.of_channel("grid")[0]["columns"])
    assert len(got) < count / 2


def test_closing_ends_the_server_while_pages_look(feed: Feed) -> None:
    server = PageServer(FeedSite(feed), "127.0.0.1", 0)
    server.start()
    with live(server) as page:
        page.next(5.0)
        began_s = time.monotonic()
        server.close()
        assert time.monotonic() - began_s < 3.0
    assert not server.running


def test_a_taken_port_is_one_sentence(feed: Feed) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(StartError, match=r"set another \[visualizer\] port in robot.toml"):
            PageServer(FeedSite(feed), "127.0.0.1", other.getsockname()[1])


@pytest.mark.requirement("VSL_MR_05")
def test_the_node_reports_its_status_ten_times_a_second_and_feeds_the_page() -> None:
    mesh = LocalMesh()
    robot, bus = mesh.endpoint("robot"), mesh.endpoint("visualizer")
    feed = Feed()
    server = PageServer(FeedSite(feed), "127.0.0.1", 0)
    node = Visualizer(feed, server)
    try:
        node.step(bus, 0.0)
        robot.take(STATUS["visualizer"])
        robot.publish(MAP, MapUpdate(0.0, 1, 0, np.zeros((3, 2), np.float32), np.zeros(3, np.uint8)))
        for k in range(1, 41):
            node.step(bus, 0.05 * k)
        reports = robot.take(STATUS["visualizer"])
        assert 19 <= len(reports) <= 22
        assert all(report.ready and server.address in report.detail for report in reports)
        assert len(feed.map_data().points_m) == 3
    finally:
        node.close()


def test_the_node_ends_when_its_server_does() -> None:
    bus = LocalMesh().endpoint("visualizer")
    feed = Feed()
    server = PageServer(FeedSite(feed), "127.0.0.1", 0)
    node = Visualizer(feed, server)
    server.close()
    with pytest.raises(RuntimeError, match="server has ended"):
        node.step(bus, 0.0)
