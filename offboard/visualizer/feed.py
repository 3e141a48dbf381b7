"""Shared by the node's thread and the server's thread: one `LiveModel` behind a lock, stamped by one clock.

The node (or whoever plays back a recording) -> `take` -> `Feed` -> messages for each client, data for the exports. A
client has one slot per channel, which is what it has seen: a slow one skips what is in between and never queues. One
that lost its connection names what it has of which model, and goes on there.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Any

from common.messages.health import Status
from common.messages.topics import Topic
from offboard.operate.bus_operator import OperatorView
from offboard.runs.run_folder import MapData
from offboard.visualizer import protocol
from offboard.visualizer.live_model import NO_RUN, LiveModel, ShownRun
from offboard.visualizer.poi_store import NoPois, PoiRecord, PoiStore


class Feed:
    """`clock` gives wall time in seconds: the page judges ages by it, also where the robot's own time is simulated."""

    def __init__(
        self,
        store: PoiStore | None = None,
        clock: Callable[[], float] = time.monotonic,
        run: ShownRun = NO_RUN,
    ) -> None:
        self.run = run
        self.on_change: Callable[[], None] = lambda: None  # called by the taking thread; must only wake somebody
        self._clock = clock
        self._store = store or NoPois()
        self._model = LiveModel()
        self.model_id = secrets.token_hex(8)  # of this very model: one after a restart numbers its map anew
        self._lock = threading.Lock()

    def take(self, topic: Topic[Any], message: Any) -> None:
        with self._lock:
            self._model.take(topic, message, self._clock())
        # Statuses are sent with the heartbeat of the page: a hundred a second need not wake the server
        if not isinstance(message, Status):
            self.on_change()

    def take_operator(self, view: OperatorView) -> None:
        self._show("operator", view)

    def take_playback(self, view: object) -> None:
        self._show("playback", view)

    def take_moments(self, moments: tuple[object, ...]) -> None:
        self._show("moments", moments)

    def take_log(self, lines: tuple[object, ...]) -> None:
        self._show("log", lines)

    def take_many(self, messages: Iterable[tuple[Topic[Any], Any]]) -> None:
        """Of a recording, as one change."""
        with self._lock:
            self._take_all(messages)
        self.on_change()

    def begin_anew(self, messages: Iterable[tuple[Topic[Any], Any]]) -> None:
        """From the beginning of a recording on, as one change."""
        with self._lock:
            self._model.begin_anew()
            self._take_all(messages)
        self.on_change()

    def _take_all(self, messages: Iterable[tuple[Topic[Any], Any]]) -> None:
        for topic, message in messages:
            self._model.take(topic, message, self._clock())
        self._model.path_changed()

    def _show(self, channel: str, value: object) -> None:
        with self._lock:
            self._model.show(channel, value)
        self.on_change()

    def refresh_pois(self) -> None:
        """Take in what the recorder has kept since the last call."""
        records: Iterable[PoiRecord] | None = self._store.read()
        if records is None:
            return
        with self._lock:
            self._model.take_stored(records)
        self.on_change()

    def client(self, held: Held | None = None) -> Client:
        """`held`: what a page that comes back says that it has."""
        seen: protocol.Seen = {}
        with self._lock:
            epoch, length = self._model.tokens["map"]
        if held is not None and held.model_id == self.model_id and held.epoch == epoch and held.points <= length:
            seen["map"] = held.epoch, held.points
        return Client(self._model, self._lock, self._clock, seen)

    def map_data(self) -> MapData:
        with self._lock:
            return self._model.map_data()

    def drawn(self) -> Hashable:
        """Another value whenever `map_data` is another."""
        with self._lock:
            return self._model.drawn()

    def photo(self, poi_id: int) -> bytes | None:
        """The newest photo of a point of interest, as JPEG."""
        with self._lock:
            live = self._model.photos.get(poi_id)
        return live if live is not None else self._store.photo(poi_id)


@dataclass(frozen=True, slots=True)
class Held:
    """How much of the map a page has: so many points of that epoch of that model."""

    model_id: str
    epoch: int
    points: int


class Client:
    """What one page has seen."""

    def __init__(self, model: LiveModel, lock: threading.Lock, clock: Callable[[], float], seen: protocol.Seen) -> None:
        self._model, self._lock, self.now_s = model, lock, clock
        self._seen = seen
        self._skipped = 0

    def urgent(self) -> protocol.PageMessage | None:
        """The next short message that is new to this client."""
        with self._lock:
            before = self._seen.get("pose")
            message = protocol.urgent(self._model, self._seen)
            if before is not None:
                self._skipped += max(0, self._seen["pose"][0] - before[0] - 1)
            return message

    def bulk(self, channel: str) -> protocol.PageMessage | None:
        """The next message of this channel that is new to this client."""
        with self._lock:
            return protocol.bulk(self._model, self._seen, channel)

    def heartbeat(self, echo: tuple[float, float] | None = None) -> protocol.PageMessage:
        with self._lock:
            return protocol.heartbeat(self._model, self.now_s(), self._skipped, echo)
