"""The bus between processes: Zenoh below the same `Bus` protocol as `LocalBus`.

A node's thread calls `publish`, `latest`, `take`, `age_s`; what is behind them stands in zenoh_outbox.py,
zenoh_inbox.py and zenoh_end.py. Commands have a session, hence a TCP connection, of their own: priorities cannot
overtake bytes that already sit in a TCP buffer. Where there are keys, commands are signed and verified here
(command_gate.py); nodes are not involved.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, Generic, TypeVar

import zenoh

from common.bundle import Packed
from common.clock import Announcements, Clock
from common.config import Config
from common.messages.topics import PERMIT, QosProfile, Topic
from common.recording import Losses, RecordedMessage, RecordingSubscriber
from common.release import Release, release_of_key
from common.zenoh_channel import Mode
from common.zenoh_end import Arrival, ZenohEnd
from common.zenoh_inbox import QUERY_TIMEOUT_S, Decoder, Inbox
from common.zenoh_outbox import Outbox, Replies
from common.zenoh_session import lease_s

P = TypeVar("P")

LOST_S = 0.5  # wall time; under the shared clock, a message that was announced and is later than this will not come

_log = logging.getLogger(__name__)


class ZenohBus:
    """One node's bus. `end`: of the process that it shares with other nodes; without one it opens one of its own.

    Raises what `ZenohEnd` raises. Close it in `finally`.
    """

    def __init__(
        self, name: str, config: Config, clock: Clock, mode: Mode = "peer", end: ZenohEnd | None = None
    ) -> None:
        self.name = name
        self._decoder = Decoder()
        self.decode_errors = self._decoder.undecodable.counts  # by topic
        self._clock = clock
        self._boot_id = secrets.randbits(48)
        self._inboxes: dict[str, Inbox[Any]] = {}
        self._outboxes: dict[str, Outbox[Any]] = {}
        self._replies = Replies()
        self._step = 0  # counts the steps: within one, what was looked at stays as it is
        self._held: dict[str, list[Packed]] | None = None  # by bundle, while they are collected
        self._tokens: set[tuple[str, Release]] = set()
        self._recording: RecordingSubscriber | None = None
        self._keep: Callable[[str, bytes], None] | None = None
        self.announced: Announcements | None = None  # set under the shared clock: what was published
        self._arrival = threading.Event()
        self._wakes_on: frozenset[str] = frozenset()
        self._ring: Callable[[], None] = lambda: None
        self._owns_end = end is None
        self._end = end or ZenohEnd(name, config, mode, lease_s(name, clock.lease_s))
        self.gate = self._end.gates[name]
        self._token: Any = None
        try:
            if self.gate.wants_challenges:
                challenges = _Handler(PERMIT, self._decoder, lambda permit: self.gate.receive(permit.challenge))
                self._end.read(PERMIT, challenges, as_command=True)
            self._token_watch = self._end.watch_tokens(self._on_token)
            if mode != "client":
                self._token = self._end.declare_token(name)
        except BaseException:
            self.close()
            raise

    def close(self) -> bool:
        """Leaves the mesh; to be called once more does no harm. False when Zenoh is not done yet."""
        if self._owns_end:
            return self._end.close()
        token, self._token = self._token, None
        if token is not None:
            token.undeclare()
        return True

    def alive_tokens(self) -> frozenset[str]:
        """The modules whose Zenoh runtime lives; whether their own loop runs is not known by that."""
        return frozenset(module for module, _ in self._tokens.copy())

    def alive_releases(self) -> frozenset[tuple[str, Release]]:
        """Those modules, each with the release that it runs."""
        return frozenset(self._tokens.copy())

    def published(self) -> dict[tuple[str, int], int]:
        """What went out so far: topic and boot id -> newest sequence number."""
        return {(key, self._boot_id): outbox.sequence for key, outbox in self._outboxes.copy().items()}

    def publish(self, topic: Topic[P], payload: P, *, news: bool = True) -> None:
        outbox = self._outboxes.get(topic.key)
        if outbox is None:
            outbox = self._outboxes[topic.key] = Outbox(self._end, topic, self._boot_id, self._replies)
        if self.gate.holds_back(topic, payload):
            return
        outbox.publish(payload, partial(self.gate.sign, topic, payload), self._send, news=news)
        if self.announced is not None and topic.consumers and topic.qos in (QosProfile.LATEST, QosProfile.COMMAND):
            self.announced.note(topic.key, self._boot_id, outbox.sequence)

    @contextmanager
    def bundling(self) -> Iterator[None]:
        """What is published within it, by this thread, leaves together at its end; outside, each message at once."""
        held = self._held = {}
        self._step += 1
        try:
            yield
        finally:
            self._held = None
            for bundle_key, messages in held.items():
                self._end.put_bundle(bundle_key, messages)

    def _send(self, topic: Topic[Any], data: bytes, news: bool) -> None:
        held = {} if self._held is None else self._held
        held.setdefault(topic.bundle_key, []).append((topic.key, data, news))
        if held is not self._held:
            self._end.put_bundle(topic.bundle_key, held[topic.bundle_key])

    def wake_on(self, topics: Iterable[Topic[Any]], ring: Callable[[], None]) -> None:
        """Zenoh's threads call `ring` for every message of these topics; before any of them is looked at."""
        self._ring = ring
        self._wakes_on = frozenset(topic.key for topic in topics)
        for topic in topics:
            self._inbox(topic)

    def latest(self, topic: Topic[P]) -> P | None:
        return self._looked_at(topic).newest

    def take(self, topic: Topic[P]) -> list[P]:
        return self._inbox(topic).take()

    def age_s(self, topic: Topic[Any]) -> float:
        return max(0.0, self._clock.step_s() - self._looked_at(topic).arrived_s)

    def await_messages(self, expected: Announcements, stop: threading.Event) -> None:
        """Waits for what was announced on the topics that this process reads; what is lost holds it for LOST_S."""
        marks = expected.take()
        deadline_s = time.monotonic() + LOST_S
        while not stop.is_set():
            self._arrival.clear()
            missing = [mark for mark in zip(*marks, strict=True) if self._in_transit(*mark)]
            if not missing:
                return
            if time.monotonic() > deadline_s:
                _log.info("announced messages were lost topics=%s", [key for key, _, _ in missing])
                return
            self._arrival.wait(0.05)

    def _in_transit(self, key: str, boot_id: int, sequence: int) -> bool:
        inbox = self._inboxes.get(key)
        if inbox is None:
            return False
        inbox.look()
        # The first message of a sender may be older than the subscription: that one is not waited for
        known = inbox.sequences.get(boot_id)
        return known is not None and known < sequence

    def subscribe(self, topic: Topic[P], handler: Callable[[P], None]) -> None:
        """Hands every message to `handler` on Zenoh's thread, for the shared clock: it must only store."""
        self._end.read(topic, _Handler(topic, self._decoder, handler))

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        """From now on `take_recorded` gives every message of these topics; to be called once."""
        by_key = {topic.key: topic for topic in topics}
        on_event = [key for key, t in by_key.items() if t.qos is QosProfile.STATE or not t.rate_hz]
        recording = self._recording = RecordingSubscriber(
            by_key, on_event, known, lambda key, query: self._query_producer(by_key[key], query)
        )
        for key, topic in by_key.items():
            self._end.read(topic, _Recorded(key, recording, self._keep))

    def spool(self, keep: Callable[[str, bytes], None]) -> None:
        """Calls `keep` with key and bytes of every recorded message of this process; to be called before `record`."""
        self._keep = keep

    def take_recorded(self) -> list[RecordedMessage]:
        return self._recording.messages() if self._recording is not None else []

    def take_lost(self) -> Losses:
        return self._recording.take_lost() if self._recording is not None else {}

    def _query_producer(self, topic: Topic[Any], query: bytes) -> None:
        recording = self._recording
        assert recording is not None

        def store(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                recording.add_reply(topic.key, bytes(reply.ok.payload))

        self._end.session_for(topic).get(
            self._end.key(topic),
            zenoh.handlers.Callback(store, indirect=False),
            payload=query,
            timeout=QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.ALL,
        )

    def _inbox(self, topic: Topic[P]) -> Inbox[P]:
        """The topic's inbox; made at its first use."""
        inbox: Inbox[P] | None = self._inboxes.get(topic.key)
        if inbox is None:
            arrived = partial(self._arrived, topic.key in self._wakes_on)
            inbox = Inbox(self._end, topic, self._clock, self._decoder, self.gate.refuses, arrived)
            self._inboxes[topic.key] = inbox
        return inbox

    def _arrived(self, wakes: bool, news: bool) -> None:
        self._arrival.set()
        if wakes and news:
            self._ring()

    def _looked_at(self, topic: Topic[P]) -> Inbox[P]:
        inbox = self._inbox(topic)
        if self._held is None or inbox.looked_in != self._step:
            inbox.looked_in = self._step
            inbox.look()
        return inbox

    def _on_token(self, sample: zenoh.Sample) -> None:
        _, module, _, release_key = str(sample.key_expr).split("/", 3)
        release = release_of_key(release_key)
        if release is None:
            return
        if sample.kind == zenoh.SampleKind.DELETE:
            self._tokens.discard((module, release))
            self._ring()  # whoever watches over the modules must know
            return
        self._tokens.add((module, release))
        if self._recording is not None:
            self._recording.query_all()
        for key, inbox in self._inboxes.copy().items():
            if key.split("/")[0] == module:
                inbox.publisher_appears()


class _Handler(Generic[P]):
    """Reads a topic for a function that is called on Zenoh's thread."""

    def __init__(self, topic: Topic[P], decoder: Decoder, handler: Callable[[P], None]) -> None:
        self._topic, self._decoder, self._handler = topic, decoder, handler

    def store(self, arrival: Arrival) -> None:
        envelope = self._decoder.read(self._topic, arrival)
        if envelope is not None:
            self._handler(envelope.payload)

    def has_come(self, *, news: bool) -> None:
        """The handler was called already."""

    def count_bad(self, problem: str) -> None:
        self._decoder.undecodable.count(self._topic.key, problem)


class _Recorded:
    """Reads a topic for the recording."""

    def __init__(self, key: str, recording: RecordingSubscriber, keep: Callable[[str, bytes], None] | None) -> None:
        self._key, self._recording, self._keep = key, recording, keep

    def store(self, arrival: Arrival) -> None:
        if not arrival.is_own:
            self._recording.store(self._key, arrival.data)
            return
        if self._keep is not None:
            self._keep(self._key, arrival.data)
        assert arrival.envelope is not None
        _, sequence, boot_id = arrival.envelope
        self._recording.store_own(RecordedMessage(self._key, boot_id, sequence, arrival.data))

    def has_come(self, *, news: bool) -> None:
        """It waits for the next look."""

    def count_bad(self, problem: str) -> None:
        self._recording.count_bad(self._key, problem)
