"""What goes to a page over a slow link: the map arrives, in pieces, and the robot is never late behind it."""

from __future__ import annotations

import json
from collections import deque
from typing import Any

import numpy as np
import pytest

from common.messages.mapping import MapUpdate, PoseEstimate, Trajectory
from common.messages.topics import MAP, POSE, TRAJECTORY
from offboard.visualizer.feed import Feed
from offboard.visualizer.outbound import WINDOW_BYTES, Outbound
from offboard.visualizer.protocol import PIECE_BYTES, text_message
from offboard.visualizer.requests import BadRequest, Confirmation, parse
from tests.page_socket import Frame, Parts, unpacked

HELLO = text_message("hello")
STEP_S = 0.01


class Page:
    """A page behind a link that carries so many bytes a second, each of them so much later."""

    def __init__(self, bytes_s: float, delay_s: float) -> None:
        self.now_s = 0.0
        self.feed = Feed(clock=lambda: self.now_s)
        self.outbound = Outbound(self.feed.client(), HELLO)
        self.received: list[tuple[float, Frame]] = []  # whole messages, and when they arrived
        self._bytes_s, self._delay_s = bytes_s, delay_s
        self._free_s = 0.0
        self._under_way: deque[tuple[float, str | bytes]] = deque()
        self._confirming: deque[tuple[float, str]] = deque()
        self._parts = Parts()
        self._received_bytes = 0

    def run(self, until_s: float) -> None:
        """A pose every 100 ms."""
        while self.now_s < until_s:
            if round(self.now_s / STEP_S) % 10 == 0:
                self.feed.take(POSE, PoseEstimate(self.now_s, 1.0, 1.0, 0.0, 0.0, 0.02, 0.01, 1))
            self._step()
            self.now_s += STEP_S

    def _step(self) -> None:
        while self._confirming and self._confirming[0][0] <= self.now_s:
            confirmation = parse(self._confirming.popleft()[1], "")
            assert isinstance(confirmation, Confirmation)
            self.outbound.confirm(confirmation)
        while (message := self.outbound.next()) is not None:
            self._free_s = max(self._free_s, self.now_s) + len(message) / self._bytes_s
            self._under_way.append((self._free_s + self._delay_s, message))
        while self._under_way and self._under_way[0][0] <= self.now_s:
            self._arrive(self._under_way.popleft()[1])

    def _arrive(self, message: str | bytes) -> None:
        self._received_bytes += len(message)
        confirmation = json.dumps({"received": self._received_bytes, "at": self.now_s})
        self._confirming.append((self.now_s + self._delay_s, confirmation))
        frame = self._parts.join(unpacked(message))
        if frame is not None:
            self.received.append((self.now_s, frame))

    def of(self, channel: str) -> list[tuple[float, dict[str, Any]]]:
        return [(at_s, head) for at_s, (head, _) in self.received if head["channel"] == channel]


def big_map(feed: Feed, points: int) -> None:
    feed.take(MAP, MapUpdate(0.0, 1, 0, np.zeros((points, 2), np.float32), np.zeros(points, np.uint8)))


@pytest.mark.requirement("VSL_MR_04")
def test_a_slow_link_brings_the_map_and_every_pose_comes_within_a_second() -> None:
    page = Page(20_000.0, 0.15)
    big_map(page.feed, 10_000)
    poses = np.zeros((4000, 3))
    page.feed.take(TRAJECTORY, Trajectory(0.0, np.arange(4000.0) - 5000.0, poses))
    page.run(30.0)
    pieces = page.of("map")
    assert sum(head["count"] for _, head in pieces) == 10_000
    assert pieces[-1][0] < 15.0
    assert len(page.of("trail")) >= 1
    late_s = [at_s - head["arrived_s"] for at_s, head in page.of("pose")]
    assert len(late_s) > 200
    assert max(late_s) < 1.0


def test_no_more_is_under_way_than_a_window_and_nothing_is_too_long() -> None:
    feed = Feed(clock=lambda: 0.0)
    big_map(feed, 10_000)
    outbound = Outbound(feed.client(), HELLO)
    sent = []
    while (message := outbound.next()) is not None:
        sent.append(message)
    assert WINDOW_BYTES <= sum(map(len, sent)) < WINDOW_BYTES + PIECE_BYTES
    assert max(map(len, sent)) < PIECE_BYTES + 200


def test_the_page_learns_what_the_servers_clock_shows_with_its_first_confirmation() -> None:
    now_s = 50.0
    outbound = Outbound(Feed(clock=lambda: now_s).client(), HELLO)
    while outbound.next() is not None:
        pass
    outbound.confirm(Confirmation(0, 7.5))
    now_s = 50.05
    message = outbound.next()
    assert isinstance(message, str)
    heartbeat = json.loads(message)
    assert (heartbeat["channel"], heartbeat["now_s"]) == ("heartbeat", 50.05)
    assert heartbeat["echo"] == [7.5, pytest.approx(0.05)]


@pytest.mark.parametrize("received_bytes", [-1, 99])
def test_a_confirmation_of_what_was_never_sent_is_refused(received_bytes: int) -> None:
    with pytest.raises(BadRequest):
        Outbound(Feed().client(), HELLO).confirm(Confirmation(received_bytes, 0.0))
