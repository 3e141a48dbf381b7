"""What a process receives of one topic: Zenoh's threads store raw bytes, which are decoded when the node looks.

STATE topics: a subscriber queries everything since the newest full snapshot when it joins, when the publisher appears,
and when what an increment goes on from is missing, and keeps what comes live until the reply. When nothing came for a
while it queries what is newer: after the last message no other shows that it was lost.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Generic, TypeVar

import zenoh

from common.bus import QUEUE_LENGTH
from common.clock import Clock
from common.codec import DecodeError, Envelope, decode, read_header
from common.messages.topics import QosProfile, Topic
from common.recording import gap_query, unpack_messages
from common.undecodable import Undecodable
from common.zenoh_end import Arrival, ZenohEnd

P = TypeVar("P")

QUERY_TIMEOUT_S = 1.0
_QUERY_PAUSE_S = 0.3  # a publisher whose numbers have holes is not queried all the time
_SILENCE_S = 3.0  # wall time
_KNOWN_BOOTS = 16

Refuses = Callable[[Topic[Any], Envelope[Any], bytes, bytes], bool]


class Decoder:
    """Bytes -> messages; `undecodable` counts what is none."""

    def __init__(self) -> None:
        self.undecodable = Undecodable()

    def decode(self, topic: Topic[P], data: bytes) -> Envelope[P] | None:
        try:
            return decode(data, topic.payload)
        except DecodeError as error:
            self.undecodable.count(topic.key, str(error))
            return None

    def read(self, topic: Topic[P], arrival: Arrival) -> Envelope[P] | None:
        """Decoded once, whoever else reads it in this process."""
        if arrival.envelope is None:
            arrival.envelope = self.decode(topic, arrival.data)
        return arrival.envelope


class Inbox(Generic[P]):
    """What one node receives of a topic. `refuses` judges commands with their signatures; `arrived` is called when
    something came, with whether it is news.

    `newest`, `arrived_s` and `sequences` (boot id -> newest number) are as of the last look.
    """

    def __init__(
        self,
        end: ZenohEnd,
        topic: Topic[P],
        clock: Clock,
        decoder: Decoder,
        refuses: Refuses,
        arrived: Callable[[bool], None],
    ) -> None:
        self.newest: P | None = None
        self.arrived_s = float("-inf")
        self.sequences: dict[int, int] = {}
        self.looked_in = -1  # the step of the node
        self._end, self._topic, self._clock = end, topic, clock
        self._decoder, self._refuses, self._arrived = decoder, refuses, arrived
        self._queue: deque[P] | None = None
        self._is_state = topic.qos is QosProfile.STATE
        # The lock guards both, which Zenoh's threads write
        self._pending: deque[tuple[float, Arrival]] = deque(
            maxlen=1 if topic.qos is QosProfile.LATEST else QUEUE_LENGTH
        )
        self._replies: list[tuple[float, bytes, bool]] = []  # the last: to a query for everything
        self._lock = threading.Lock()
        self._query_due = self._is_state
        self._query_running = self._query_refused = self._query_replied = False
        self._holding = False  # what comes live, for the reply to a query for everything
        self._queried_wall_s = self._came_wall_s = float("-inf")
        self._is_of_own = False  # what came last: that cannot be lost
        end.read(topic, self)

    def look(self) -> None:
        """Decodes all that came; while a query for everything runs, what came live waits for its reply."""
        self._read()
        if not self._is_state or self._query_running:
            return
        # Queried again while nothing at all came: subscription and first message may have crossed
        if self._query_due or self.newest is None:
            self._query(b"")
            self._read()  # a publisher of this process has replied already
        elif not (self._pending or self._is_of_own) and self._is_silent():
            self._query(gap_query(self.sequences))

    def _read(self) -> None:
        if self._holding or not (self._pending or self._replies):
            return
        with self._lock:
            replies, self._replies = self._replies, []
            live = list(self._pending)
            self._pending.clear()
        replied, self._query_replied = self._query_replied, False
        self._came_wall_s = time.monotonic()
        for arrived_s, pack, everything in replies:
            self._read_reply(arrived_s, pack, everything=everything)
        for i, (arrived_s, arrival) in enumerate(live):
            envelope = self._decoder.read(self._topic, arrival)
            if envelope is None or self._refuses(self._topic, envelope, arrival.data, arrival.signature):
                continue
            if not replied and self._misses_some(envelope):
                self._query_due = True
                with self._lock:
                    self._pending = deque([*live[i:], *self._pending], maxlen=QUEUE_LENGTH)
                return
            self._is_of_own = arrival.is_own
            self._accept(self._clock.arrival_s(arrived_s), envelope)

    def _read_reply(self, arrived_s: float, pack: bytes, *, everything: bool) -> None:
        for data in unpack_messages(pack):
            envelope = self._decoder.decode(self._topic, data)
            if envelope is None:
                self._pass_over(data)
            elif not everything and self._misses_some(envelope):
                self._query_due = True
                return
            else:
                self._accept(arrived_s, envelope)

    def _pass_over(self, data: bytes) -> None:
        """What cannot be decoded is not queried again and again."""
        with suppress(DecodeError):
            sequence, boot_id = read_header(data)
            if boot_id in self.sequences:
                self.sequences[boot_id] = max(self.sequences[boot_id], sequence)

    def take(self) -> list[P]:
        """Everything since the last call; at the first call the newest of what was looked at before."""
        if self._queue is None:
            # Before the look: the reply to the very first query may be there within it
            self._queue = deque([] if self.newest is None else [self.newest], maxlen=QUEUE_LENGTH)
            with self._lock:
                self._pending = deque(self._pending, maxlen=QUEUE_LENGTH)
        self.look()
        messages = list(self._queue)
        self._queue.clear()
        return messages

    def publisher_appears(self) -> None:
        """Called by Zenoh's thread: there is somebody now who can reply."""
        if self._is_state:
            self._query_due = True

    def store(self, arrival: Arrival) -> None:
        """Called by Zenoh's thread, or by a node of this process that publishes."""
        with self._lock:
            self._pending.append((self._clock.now_s(), arrival))

    def has_come(self, *, news: bool) -> None:
        """Called after `store`."""
        self._arrived(news)

    def count_bad(self, problem: str) -> None:
        """Called by Zenoh's thread."""
        self._decoder.undecodable.count(self._topic.key, problem)

    def _misses_some(self, envelope: Envelope[P]) -> bool:
        goes_on = self._is_state and getattr(envelope.payload, "start", 0) > 0
        return goes_on and envelope.sequence > self.sequences.get(envelope.boot_id, 0) + 1

    def _accept(self, arrived_s: float, envelope: Envelope[P] | None) -> None:
        if envelope is None or envelope.sequence <= self.sequences.get(envelope.boot_id, 0):
            return
        if envelope.boot_id not in self.sequences and len(self.sequences) >= _KNOWN_BOOTS:
            self.sequences.pop(next(iter(self.sequences)))
        self.sequences[envelope.boot_id] = envelope.sequence
        self.newest, self.arrived_s = envelope.payload, arrived_s
        if self._queue is not None:
            self._queue.append(envelope.payload)

    def _is_silent(self) -> bool:
        return time.monotonic() - max(self._came_wall_s, self._queried_wall_s) > _SILENCE_S

    def _query(self, newer_than: bytes) -> None:
        """For everything since the newest full snapshot; or for what is newer, as `gap_query` says it."""
        wall_s = time.monotonic()
        if wall_s - self._queried_wall_s < _QUERY_PAUSE_S:
            return
        self._queried_wall_s, self._query_running = wall_s, True
        self._query_refused = False
        if not newer_than:
            self._query_due, self._holding, self._query_replied = False, True, False

        def store(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                self._query_refused = True  # or it came too late
            else:
                arrival = (self._clock.now_s(), bytes(reply.ok.payload), not newer_than)
                with self._lock:
                    self._replies.append(arrival)
                # Where nobody replied, what comes live goes on from nothing
                self._query_replied |= not newer_than

        def finished() -> None:
            if self._query_refused and not newer_than:
                self._query_due, self._query_replied = True, False
            self._holding = self._query_running = False

        self._end.session_for(self._topic).get(
            self._end.key(self._topic),
            zenoh.handlers.Callback(store, finished, indirect=False),
            payload=newer_than or None,
            timeout=QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            # A query that only makes sure must not hold up a step where the link is full
            congestion_control=zenoh.CongestionControl.DROP if newer_than else zenoh.CongestionControl.BLOCK,
        )
