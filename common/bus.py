"""The bus as a node uses it: publish to a topic, read the newest message, take all new ones, check age and validity.

`LocalBus` joins nodes inside one program (`simulate`, tests); `ZenohBus` joins processes. A node cannot distinguish
them.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol, TypeVar

from common.codec import encode
from common.field_checks import UnfitValue
from common.messages.topics import Topic
from common.recording import Losses, RecordedMessage
from common.undecodable import Undecodable

P = TypeVar("P")

# An input is alive while its newest message is younger than this many periods of its declared rate
ALIVE_PERIODS = 3.0
QUEUE_LENGTH = 256
UNFIT = "not published"


class Bus(Protocol):
    """What a node can do with the mesh. Ages are judged by arrival, on the clock of the receiver."""

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        """`news`: False where it repeats what was published before, which makes no step of a reader due.

        A payload that violates its type is not sent, but counted and reported in this process's log: `UNFIT`.
        """

    def latest(self, topic: Topic[P]) -> P | None:
        """The newest message of a topic, or None when none came yet."""

    def take(self, topic: Topic[P]) -> list[P]:
        """Every message that came since the last call, oldest first (at most QUEUE_LENGTH are kept)."""

    def age_s(self, topic: Topic[Any]) -> float:
        """How long ago the newest message came; infinite when none did."""

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        """From now on `take_recorded` gives every message of these topics, but what was received before by `known`."""

    def take_recorded(self) -> list[RecordedMessage]:
        """Every message of the recorded topics since the last call, in order and once per topic and boot id."""

    def take_lost(self) -> Losses:
        """Which recorded messages were lost for good since the last call."""


def alive(bus: Bus, topic: Topic[Any]) -> bool:
    """The newest message is fresh for the topic's declared rate."""
    return bus.age_s(topic) <= ALIVE_PERIODS / topic.rate_hz


def alive_and_valid(bus: Bus, topic: Topic[Any]) -> bool:
    """Fresh, and marked valid by its sender: an output may rest on it."""
    newest = bus.latest(topic)
    return newest is not None and bool(newest.valid) and alive(bus, topic)


def expires_s(bus: Bus, topic: Topic[Any], now_s: float) -> float:
    """When the newest message stops being `alive` (s, on the clock of `now_s`); infinite when it is not alive now."""
    remaining_s = ALIVE_PERIODS / topic.rate_hz - bus.age_s(topic)
    return now_s + remaining_s if remaining_s >= 0.0 else float("inf")


class LocalMesh:
    """Joins the buses of nodes that run in one program; messages are passed as they are, in order.

    Boot ids follow from the seed, so that a recorded run repeats to the bit.
    """

    def __init__(self, seed: int = 0, bus: Callable[[LocalMesh, str, int], LocalBus] | None = None) -> None:
        """`bus` makes an endpoint of this mesh, a name and a boot id; a `LocalBus` without it."""
        self._endpoints: list[LocalBus] = []
        self._seed, self._bus = seed, bus or LocalBus
        self.now_s = 0.0

    def endpoint(self, name: str) -> LocalBus:
        boot_id = int.from_bytes(hashlib.sha256(f"{self._seed}/{name}".encode()).digest()[:6])
        bus = self._bus(self, name, boot_id)
        self._endpoints.append(bus)
        return bus

    def deliver(self, topic: Topic[Any], payload: Any, message: RecordedMessage, *, news: bool) -> None:
        key = topic.key
        for endpoint in self._endpoints:
            if key in endpoint.recorded_keys:
                endpoint.recorded.append(message)
            endpoint._receive(topic, payload, news)


class LocalBus:
    """One node's end of a `LocalMesh`. The queue of a topic begins with its first `take`."""

    def __init__(self, mesh: LocalMesh, name: str, boot_id: int) -> None:
        self._mesh = mesh
        self.name = name
        self.recorded_keys: set[str] = set()
        self.recorded: list[RecordedMessage] = []
        self._boot_id = boot_id
        self._sequences: dict[str, int] = {}
        self._unfit = Undecodable(UNFIT)
        self._inbox: dict[str, tuple[Any, float]] = {}  # by topic: the payload, and when it arrived
        self._queues: dict[str, deque[Any]] = {}
        self._wakes_on: frozenset[str] = frozenset()
        self.woken = False  # a message came of those to wake on

    def wake_on(self, topics: Iterable[Topic[Any]]) -> None:
        """Their messages set `woken`, where they bring news."""
        self._wakes_on = frozenset(topic.key for topic in topics)

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        sequence = self._sequences.get(topic.key, 0) + 1
        try:
            message = RecordedMessage(topic.key, self._boot_id, sequence, encode(payload, sequence, self._boot_id))
        except UnfitValue as error:
            self._unfit.count(topic.key, str(error))
            return
        self._sequences[topic.key] = sequence
        self._mesh.deliver(topic, payload, message, news=news)

    def latest(self, topic: Topic[P]) -> P | None:
        newest = self._inbox.get(topic.key)
        return None if newest is None else newest[0]

    def take(self, topic: Topic[P]) -> list[P]:
        queue = self._queues.get(topic.key)
        if queue is None:
            self._queues[topic.key] = deque(maxlen=QUEUE_LENGTH)
            newest = self.latest(topic)
            return [] if newest is None else [newest]
        messages: list[P] = list(queue)
        queue.clear()
        return messages

    def age_s(self, topic: Topic[Any]) -> float:
        newest = self._inbox.get(topic.key)
        return float("inf") if newest is None else self._mesh.now_s - newest[1]

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        self.recorded_keys.update(topic.key for topic in topics)

    def take_recorded(self) -> list[RecordedMessage]:
        recorded, self.recorded = self.recorded, []
        return recorded

    def take_lost(self) -> Losses:
        return {}

    def _receive(self, topic: Topic[Any], payload: Any, news: bool) -> None:
        key = topic.key
        self._inbox[key] = payload, self._mesh.now_s
        if news and key in self._wakes_on:
            self.woken = True
        queue = self._queues.get(key)
        if queue is not None:
            queue.append(payload)
