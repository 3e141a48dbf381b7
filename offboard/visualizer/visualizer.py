"""Node `visualizer`: everything that the page shows, from the bus into the `Feed`, and its own status (VSL_MR_05).

It takes every pose, map increment and point of interest, and the newest of everything else.
"""

from __future__ import annotations

from typing import Any

from common.bus import Bus
from common.messages.topics import (
    CARRIER,
    DOOR_NOTES,
    GRID,
    MAP,
    PERMIT,
    PLAN,
    POI,
    POSE,
    RANGES,
    STATUS,
    TRAJECTORY,
    ZONES,
    Topic,
)
from common.status import StatusReporter
from offboard.visualizer.feed import Feed
from offboard.visualizer.server import PageServer

REFRESH_PERIOD_S = 1.0
_EVERY_ONE: tuple[Topic[Any], ...] = (POSE, MAP, POI)
_NEWEST: tuple[Topic[Any], ...] = (RANGES, CARRIER, PLAN, PERMIT, TRAJECTORY, GRID, ZONES, DOOR_NOTES, *STATUS.values())


class Visualizer:
    """Feeds the page and watches that it is served."""

    name = "visualizer"
    period_s = 0.1
    wakes_on: tuple[Topic[Any], ...] = (POSE,)  # shown at once; everything else comes with the next one

    def __init__(self, feed: Feed, server: PageServer) -> None:
        self._feed = feed
        self._server = server
        self._status = StatusReporter(self.name)
        self._newest: dict[str, Any] = {}
        self._refresh_s = float("-inf")
        feed.refresh_pois()
        server.start()

    def step(self, bus: Bus, now_s: float) -> float:
        if not self._server.running:
            raise RuntimeError("the page's server has ended; see the log")
        for topic in _EVERY_ONE:
            for message in bus.take(topic):
                self._feed.take(topic, message)
        for topic in _NEWEST:
            newest = bus.latest(topic)
            if newest is not None and newest is not self._newest.get(topic.key):
                self._newest[topic.key] = newest
                self._feed.take(topic, newest)
        if now_s - self._refresh_s >= REFRESH_PERIOD_S:
            self._refresh_s = now_s
            self._feed.refresh_pois()
        pages = self._server.pages
        detail = f"{pages} page{'' if pages == 1 else 's'} open at {self._server.address}"
        self._status.report(bus, now_s, state="SERVING", ready=True, detail=detail)
        return self._status.latest_s

    def close(self) -> None:
        self._server.close()
