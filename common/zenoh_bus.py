"""The bus between processes: Zenoh below the same `Bus` protocol as `LocalBus`.

A node's thread calls `publish`, `latest`, `take`, `age_s`; what is behind them stands in zenoh_outbox.py and
zenoh_inbox.py. Commands have a session, hence a TCP connection, of their own: priorities cannot overtake bytes that
already sit in a TCP buffer. Where there are keys, commands are signed and verified here (command_gate.py); nodes
are not involved.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, TypeVar

import zenoh

from common.access import alive_key
from common.clock import Announcements, Clock
from common.command_gate import CommandGate
from common.config import Config
from common.messages import PERMIT, QosProfile, Topic
from common.recording import MESSAGE_BYTES_MAX, Losses, RecordedMessage, RecordingSubscriber
from common.zenoh_inbox import QUERY_TIMEOUT_S, Inbox, Reader
from common.zenoh_outbox import Outbox, Replies
from common.zenoh_session import (
    Mode,
    close_sessions,
    command_channel,
    direct,
    lease_s,
    main_channel,
    open_session,
    watch_links,
)

P = TypeVar("P")

LOST_S = 0.5  # wall time; under the shared clock, a message that was announced and is later than this will not come

_log = logging.getLogger(__name__)


class ZenohBus:
    """One process's end of the mesh. Close it in `finally`: an open session keeps a dead process's token up.

    Raises StartError when the router's port is taken, and in mode "client" when no router answers. A peer needs none.
    """

    def __init__(self, name: str, config: Config, clock: Clock, mode: Mode = "peer") -> None:
        self.name = name
        self._reader = Reader()
        self.decode_errors = self._reader.undecodable.counts  # by topic
        self._clock = clock
        self._robot = config.robot.name
        self._boot_id = secrets.randbits(48)
        self._inboxes: dict[str, Inbox[Any]] = {}
        self._outboxes: dict[str, Outbox[Any]] = {}
        self._replies = Replies()
        self._tokens: set[str] = set()
        self._recording: RecordingSubscriber | None = None
        self._subscribers: list[Any] = []  # subscribers without an inbox
        self.announced: Announcements | None = None  # set under the shared clock: what was published
        self._arrival = threading.Event()
        self._wakes_on: frozenset[str] = frozenset()
        self._ring: Callable[[], None] = lambda: None
        self.gate = CommandGate(name, config)
        main, commands = main_channel(name, mode, config), command_channel(name, mode, config)
        lease = lease_s(name, clock.lease_s)
        self._session = self._command_session = open_session(main, lease)
        self._token: Any = None
        try:
            if commands is not None:
                self._command_session = open_session(commands, lease)
            if self.gate.wants_challenges:
                self._subscribe(self._command_session, PERMIT, lambda permit: self.gate.receive(permit.challenge))
            self._link_watch = watch_links(self._session) if main.rules is not None else None
            self._token_watch = self._session.liveliness().declare_subscriber(
                f"{self._robot}/{alive_key('*')}", direct(self._on_token), history=True
            )
            if mode != "client":
                self._token = self._session.liveliness().declare_token(f"{self._robot}/{alive_key(name)}")
        except BaseException:
            self.close()
            raise

    def close(self) -> bool:
        """Leaves the mesh; to be called once more does no harm. False when Zenoh is not done yet."""
        return close_sessions((self._command_session, self._session))

    def alive_tokens(self) -> frozenset[str]:
        """The modules whose Zenoh runtime lives; whether their own loop runs is not known by that."""
        return frozenset(self._tokens.copy())

    def published(self) -> dict[tuple[str, int], int]:
        """What went out so far: topic and boot id -> newest sequence number."""
        return {(key, self._boot_id): outbox.sequence for key, outbox in self._outboxes.copy().items()}

    def publish(self, topic: Topic[P], payload: P) -> None:
        outbox = self._outboxes.get(topic.key)
        if outbox is None:
            session = self._session_for(topic)
            outbox = Outbox(session, self._key(topic), topic, self._boot_id, self._replies)
            self._outboxes[topic.key] = outbox
        if self.gate.holds_back(topic, payload):
            return
        outbox.publish(payload, partial(self.gate.sign, topic, payload))
        if self.announced is not None and topic.consumers and topic.qos in (QosProfile.LATEST, QosProfile.COMMAND):
            self.announced.note(topic.key, self._boot_id, outbox.sequence)

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
        self._subscribe(self._session_for(topic), topic, handler)

    def record(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        """From now on `take_recorded` gives every message of these topics; to be called once."""
        by_key = {topic.key: topic for topic in topics}
        on_event = [key for key, t in by_key.items() if t.qos is QosProfile.STATE or not t.rate_hz]
        recording = self._recording = RecordingSubscriber(
            by_key, on_event, known, lambda key, query: self._query_producer(by_key[key], query)
        )

        def store(key: str, sample: zenoh.Sample) -> None:
            if len(sample.payload) > MESSAGE_BYTES_MAX:
                recording.count_bad(key, f"{len(sample.payload)} bytes are too many")
            else:
                recording.store(key, bytes(sample.payload))

        for key, topic in by_key.items():
            session = self._session_for(topic)
            self._subscribers.append(session.declare_subscriber(self._key(topic), direct(partial(store, key))))

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

        self._session.get(
            self._key(topic),
            zenoh.handlers.Callback(store, indirect=False),
            payload=query,
            timeout=QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.ALL,
        )

    def _key(self, topic: Topic[Any]) -> str:
        return f"{self._robot}/{topic.key}"

    def _session_for(self, topic: Topic[Any]) -> zenoh.Session:
        return self._command_session if topic.is_command else self._session

    def _inbox(self, topic: Topic[P]) -> Inbox[P]:
        """The topic's inbox; made at its first use."""
        inbox: Inbox[P] | None = self._inboxes.get(topic.key)
        if inbox is None:
            session, refuses = self._session_for(topic), self.gate.refuses
            arrived = self._arrived_to_wake if topic.key in self._wakes_on else self._arrival.set
            inbox = Inbox(session, self._key(topic), topic, self._clock, self._reader, refuses, arrived)
            self._inboxes[topic.key] = inbox
        return inbox

    def _arrived_to_wake(self) -> None:
        self._arrival.set()
        self._ring()

    def _looked_at(self, topic: Topic[P]) -> Inbox[P]:
        inbox = self._inbox(topic)
        inbox.look()
        return inbox

    def _subscribe(self, session: zenoh.Session, topic: Topic[P], handler: Callable[[P], None]) -> None:
        def receive(sample: zenoh.Sample) -> None:
            envelope = self._reader.read(topic, bytes(sample.payload))
            if envelope is not None:
                handler(envelope.payload)

        self._subscribers.append(session.declare_subscriber(self._key(topic), direct(receive)))

    def _on_token(self, sample: zenoh.Sample) -> None:
        module = str(sample.key_expr).split("/")[1]
        if sample.kind == zenoh.SampleKind.DELETE:
            self._tokens.discard(module)
            return
        self._tokens.add(module)
        if self._recording is not None:
            self._recording.query_all()
        for key, inbox in self._inboxes.copy().items():
            if key.split("/")[0] == module:
                inbox.publisher_appears()
