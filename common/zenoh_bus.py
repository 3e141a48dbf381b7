"""The bus between processes: Zenoh below the same `Bus` protocol as `LocalBus`.

A node's thread calls `publish`, `latest`, `take`, `age_s`; Zenoh's threads only store raw bytes with their time of
arrival, which are decoded when the node looks. Commands have a session, hence a TCP connection, of their own:
priorities cannot overtake bytes that already sit in a TCP buffer. Where there are keys they are signed and judged here
(command_gate.py), so that no node knows of it.

STATE topics: the publisher answers a query with everything since its newest full snapshot; a subscriber asks when it
joins, when the publisher appears, and when a sequence number is missing, and keeps what comes live until the answer.
Recorded topics answer the same query with a question in it (`frames.question`) from their newest messages, so that who
records them misses nothing while it is restarted.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import msgpack
import zenoh

from common.access import alive_key
from common.bus import QUEUE_LENGTH
from common.clock import Announcements, Clock
from common.codec import DecodeError, Envelope, decode, encode
from common.command_gate import CommandGate
from common.config import Config
from common.frames import MESSAGE_BYTES_MAX, Frame, Losses, RecentMessages, Tap, asked_after
from common.messages import PERMIT, Stance, Topic
from common.signing import SEAL_BYTES
from common.zenoh_session import (
    Mode,
    close_sessions,
    command_way,
    direct,
    lease_s,
    main_way,
    open_session,
    watch_links,
)

P = TypeVar("P")

LOST_S = 0.5  # wall time; under the shared clock, a message that was announced and is later than this will not come
_QUERY_TIMEOUT_S = 1.0
_QUERY_PAUSE_S = 0.3  # a publisher whose numbers have holes is not asked all the time
_KNOWN_BOOTS = 16

_log = logging.getLogger(__name__)

_PRIORITY = {
    Stance.COMMAND: zenoh.Priority.REAL_TIME,
    Stance.LATEST: zenoh.Priority.DATA_HIGH,
    Stance.EVENT: zenoh.Priority.DATA,
    Stance.STATE: zenoh.Priority.DATA_LOW,
    Stance.BULK: zenoh.Priority.BACKGROUND,
}
# Nobody waits for a full link, or the robot would stand for it: what is recorded and was dropped is asked for again
_CONGESTION = zenoh.CongestionControl.DROP


@dataclass(slots=True)
class _Inbox:
    """What came of one topic. `lock` guards `pending` and `replies`, which Zenoh's threads write."""

    topic: Topic[Any]
    pending: deque[tuple[float, bytes, bytes]]  # arrival, message, its seal
    lock: threading.Lock = field(default_factory=threading.Lock)
    replies: list[tuple[float, bytes]] = field(default_factory=list)
    query_due: bool = False
    query_running: bool = False
    query_answered: bool = False
    asked_wall_s: float = float("-inf")
    newest: Any = None
    arrived_s: float = float("-inf")
    queue: deque[Any] | None = None
    sequences: dict[int, int] = field(default_factory=dict)  # boot id -> newest sequence number
    subscriber: Any = None


@dataclass(slots=True)
class _Outbox:
    publisher: Any
    sequence: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)
    history: list[bytes] = field(default_factory=list)  # STATE: everything since the newest full snapshot
    recent: RecentMessages = field(default_factory=RecentMessages)  # of a recorded topic
    queryable: Any = None


class ZenohBus:
    """One process's end of the mesh. Close it in `finally`: an open session keeps a dead process's token up.

    Raises StartError when the router's port is taken, and in mode "client" when no router answers. A peer needs none.
    """

    def __init__(self, name: str, config: Config, clock: Clock, mode: Mode = "peer") -> None:
        self.name = name
        self.decode_errors: dict[str, int] = {}
        self._clock = clock
        self._robot = config.robot.name
        self._boot_id = secrets.randbits(48)
        self._inboxes: dict[str, _Inbox] = {}
        self._outboxes: dict[str, _Outbox] = {}
        self._tokens: set[str] = set()
        self._tap: Tap | None = None
        self._tap_subscribers: list[Any] = []
        self.announced: Announcements | None = None  # set under the shared clock: what was published
        self._arrival = threading.Event()
        self.gate = CommandGate(name, config)
        own_way, for_commands = main_way(name, mode, config), command_way(name, mode, config)
        lease = lease_s(name, clock.lease_s)
        self._session = self._command_session = open_session(own_way, lease)
        self._token: Any = None
        try:
            if for_commands is not None:
                self._command_session = open_session(for_commands, lease)
            if self.gate.wants_challenges:
                self._challenges = self._command_session.declare_subscriber(
                    self._key(PERMIT), direct(self._hear_challenge)
                )
            self._link_watch = watch_links(self._session) if own_way.rules is not None else None
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
        """The modules whose Zenoh runtime lives; that says nothing yet about their own loop."""
        return frozenset(self._tokens.copy())

    def published(self) -> dict[tuple[str, int], int]:
        """What went out so far: topic and boot id -> newest sequence number."""
        return {(key, self._boot_id): outbox.sequence for key, outbox in self._outboxes.copy().items()}

    def publish(self, topic: Topic[P], payload: P) -> None:
        outbox = self._outboxes.get(topic.key)
        if outbox is None:
            outbox = self._outboxes[topic.key] = self._declare(topic)
        if self.gate.holds_back(topic, payload):
            return
        outbox.sequence += 1
        data = encode(payload, outbox.sequence, self._boot_id)
        if topic.recorded:
            with outbox.lock:
                outbox.recent.append(outbox.sequence, data)
        if topic.stance is Stance.STATE:
            with outbox.lock:
                # An increment (`MapUpdate.start` > 0) is worth nothing without what it goes on from
                if not getattr(payload, "start", 0):
                    outbox.history.clear()
                outbox.history.append(data)
        outbox.publisher.put(data, attachment=self.gate.seal(topic, payload, data))
        if self.announced is not None and topic.consumers and topic.stance in (Stance.LATEST, Stance.COMMAND):
            self.announced.note(topic.key, self._boot_id, outbox.sequence)

    def latest(self, topic: Topic[P]) -> P | None:
        newest: P | None = self._drained(topic).newest
        return newest

    def take(self, topic: Topic[P]) -> list[P]:
        inbox = self._drained(topic)
        if inbox.queue is None:
            inbox.queue = deque(maxlen=QUEUE_LENGTH)
            with inbox.lock:
                inbox.pending = deque(inbox.pending, maxlen=QUEUE_LENGTH)
            return [] if inbox.newest is None else [inbox.newest]
        messages: list[P] = list(inbox.queue)
        inbox.queue.clear()
        return messages

    def age_s(self, topic: Topic[Any]) -> float:
        return max(0.0, self._clock.step_s() - self._drained(topic).arrived_s)

    def await_messages(self, expected: Announcements, stop: threading.Event) -> None:
        """Waits for what was announced on the topics that this process reads; what is lost holds it for LOST_S."""
        marks = expected.take()
        deadline_s = time.monotonic() + LOST_S
        while not stop.is_set():
            self._arrival.clear()
            missing = [mark for mark in zip(*marks, strict=True) if self._on_its_way(*mark)]
            if not missing:
                return
            if time.monotonic() > deadline_s:
                _log.info("announced messages were lost topics=%s", [key for key, _, _ in missing])
                return
            self._arrival.wait(0.05)

    def _on_its_way(self, key: str, boot_id: int, sequence: int) -> bool:
        inbox = self._inboxes.get(key)
        if inbox is None:
            return False
        # The first message of a sender may be older than the subscription: nobody waits for that one
        known = self._drained(inbox.topic).sequences.get(boot_id)
        return known is not None and known < sequence

    def listen(self, topic: Topic[P], handler: Callable[[P], None]) -> None:
        """Hands every message to `handler` on Zenoh's thread, for the shared clock: it must only store."""

        def receive(sample: zenoh.Sample) -> None:
            envelope = self._decoded(topic, bytes(sample.payload))
            if envelope is not None:
                handler(envelope.payload)

        subscriber = self._session_for(topic).declare_subscriber(self._key(topic), direct(receive))
        self._inboxes[topic.key] = _Inbox(topic, deque(maxlen=1), subscriber=subscriber)

    def tap(self, topics: Iterable[Topic[Any]], known: Mapping[tuple[str, int], int]) -> None:
        """From now on `take_frames` gives every message of these topics; to be called once."""
        by_key = {topic.key: topic for topic in topics}
        on_event = [key for key, t in by_key.items() if t.stance is Stance.STATE or not t.rate_hz]
        tap = self._tap = Tap(by_key, on_event, known, lambda key, asked: self._ask_producer(by_key[key], asked))

        def subscribe(topic: Topic[Any]) -> Any:
            def store(sample: zenoh.Sample) -> None:
                if len(sample.payload) > MESSAGE_BYTES_MAX:
                    tap.count_bad(topic.key, f"{len(sample.payload)} bytes are too many")
                else:
                    tap.store(topic.key, bytes(sample.payload))

            return self._session_for(topic).declare_subscriber(self._key(topic), direct(store))

        self._tap_subscribers = [subscribe(topic) for topic in by_key.values()]

    def take_frames(self) -> list[Frame]:
        return self._tap.frames() if self._tap is not None else []

    def take_lost(self) -> Losses:
        return self._tap.take_lost() if self._tap is not None else {}

    def _ask_producer(self, topic: Topic[Any], asked: bytes) -> None:
        tap = self._tap
        assert tap is not None

        def store(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                tap.answer(topic.key, bytes(reply.ok.payload))

        self._session.get(
            self._key(topic),
            zenoh.handlers.Callback(store, indirect=False),
            payload=asked,
            timeout=_QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.ALL,
        )

    # Sending

    def _key(self, topic: Topic[Any]) -> str:
        return f"{self._robot}/{topic.key}"

    def _session_for(self, topic: Topic[Any]) -> zenoh.Session:
        return self._command_session if topic.is_command else self._session

    def _declare(self, topic: Topic[Any]) -> _Outbox:
        publisher = self._session_for(topic).declare_publisher(
            self._key(topic), priority=_PRIORITY[topic.stance], congestion_control=_CONGESTION
        )
        outbox = _Outbox(publisher)
        if topic.recorded or topic.stance is Stance.STATE:

            def answer(query: zenoh.Query) -> None:
                asked = query.payload
                with outbox.lock:
                    if asked is None:
                        messages = outbox.history
                    else:
                        messages = outbox.recent.after(asked_after(bytes(asked), self._boot_id))
                    pack = msgpack.packb(messages)
                query.reply(self._key(topic), pack)

            outbox.queryable = self._session_for(topic).declare_queryable(self._key(topic), direct(answer))
        return outbox

    # Receiving

    def _hear_challenge(self, sample: zenoh.Sample) -> None:
        envelope = self._decoded(PERMIT, bytes(sample.payload))
        if envelope is not None:
            self.gate.hear(envelope.payload.challenge)

    def _on_token(self, sample: zenoh.Sample) -> None:
        module = str(sample.key_expr).split("/")[1]
        if sample.kind == zenoh.SampleKind.DELETE:
            self._tokens.discard(module)
            return
        self._tokens.add(module)
        if self._tap is not None:
            self._tap.ask_all()
        for inbox in list(self._inboxes.values()):
            if inbox.topic.stance is Stance.STATE and inbox.topic.producer == module:
                inbox.query_due = True

    def _subscribe(self, topic: Topic[Any]) -> _Inbox:
        newest_only = topic.stance is Stance.LATEST
        inbox = _Inbox(topic, deque(maxlen=1 if newest_only else QUEUE_LENGTH))
        inbox.query_due = topic.stance is Stance.STATE

        def store(sample: zenoh.Sample) -> None:
            if len(sample.payload) > MESSAGE_BYTES_MAX:
                self._count_error(topic, ValueError(f"{len(sample.payload)} bytes are too many"))
                return
            arrival = (self._clock.now_s(), bytes(sample.payload), _seal_of(sample))
            with inbox.lock:
                inbox.pending.append(arrival)
            self._arrival.set()

        inbox.subscriber = self._session_for(topic).declare_subscriber(self._key(topic), direct(store))
        self._inboxes[topic.key] = inbox
        return inbox

    def _drained(self, topic: Topic[Any]) -> _Inbox:
        """The topic's inbox with all that came decoded; while a query runs, what came live waits for its answer."""
        inbox = self._inboxes.get(topic.key)
        if inbox is None:
            inbox = self._subscribe(topic)
        # Asked again while nothing at all came: subscription and first message may have crossed on the way
        empty = topic.stance is Stance.STATE and inbox.newest is None
        if (inbox.query_due or empty) and not inbox.query_running:
            self._ask(inbox)
        if inbox.query_running or not (inbox.pending or inbox.replies):
            return inbox
        with inbox.lock:
            replies, inbox.replies = inbox.replies, []
            live = list(inbox.pending)
            inbox.pending.clear()
        answered, inbox.query_answered = inbox.query_answered, False
        for arrived_s, pack in replies:
            for data in self._unpacked(topic, pack):
                self._accept(inbox, arrived_s, self._decoded(topic, data))
        for i, (arrived_s, data, sealed) in enumerate(live):
            envelope = self._decoded(topic, data)
            if envelope is not None and self.gate.refuses(topic, envelope, data, sealed):
                continue
            if not answered and envelope is not None and self._misses_some(inbox, envelope):
                inbox.query_due = True
                with inbox.lock:
                    inbox.pending = deque([*live[i:], *inbox.pending], maxlen=QUEUE_LENGTH)
                return inbox
            self._accept(inbox, self._clock.arrival_s(arrived_s), envelope)
        return inbox

    def _unpacked(self, topic: Topic[Any], pack: bytes) -> list[bytes]:
        try:
            snapshot: list[bytes] = msgpack.unpackb(pack)
        except (ValueError, msgpack.UnpackException) as error:
            self._count_error(topic, error)
            return []
        return snapshot

    def _decoded(self, topic: Topic[P], data: bytes) -> Envelope[P] | None:
        try:
            return decode(data, topic.payload)
        except DecodeError as error:
            self._count_error(topic, error)
            return None

    @staticmethod
    def _misses_some(inbox: _Inbox, envelope: Envelope[Any]) -> bool:
        seen = inbox.sequences.get(envelope.boot_id, 0)
        return inbox.topic.stance is Stance.STATE and envelope.sequence > seen + 1

    @staticmethod
    def _accept(inbox: _Inbox, arrived_s: float, envelope: Envelope[Any] | None) -> None:
        if envelope is None or envelope.sequence <= inbox.sequences.get(envelope.boot_id, 0):
            return
        if envelope.boot_id not in inbox.sequences and len(inbox.sequences) >= _KNOWN_BOOTS:
            inbox.sequences.pop(next(iter(inbox.sequences)))
        inbox.sequences[envelope.boot_id] = envelope.sequence
        inbox.newest, inbox.arrived_s = envelope.payload, arrived_s
        if inbox.queue is not None:
            inbox.queue.append(envelope.payload)

    def _ask(self, inbox: _Inbox) -> None:
        wall_s = time.monotonic()
        if wall_s - inbox.asked_wall_s < _QUERY_PAUSE_S:
            return
        inbox.asked_wall_s, inbox.query_due, inbox.query_running = wall_s, False, True

        def store(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                arrival = (self._clock.now_s(), bytes(reply.ok.payload))
                with inbox.lock:
                    inbox.replies.append(arrival)

        def finished() -> None:
            inbox.query_answered = True
            inbox.query_running = False

        self._session.get(
            self._key(inbox.topic),
            zenoh.handlers.Callback(store, finished, indirect=False),
            timeout=_QUERY_TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _count_error(self, topic: Topic[Any], error: Exception) -> None:
        count = self.decode_errors[topic.key] = self.decode_errors.get(topic.key, 0) + 1
        # With every doubling: of a sender of another version nothing else would come
        if count & (count - 1) == 0:
            _log.warning("undecodable topic=%s error=%s count=%d", topic.key, error, count)


def _seal_of(sample: zenoh.Sample) -> bytes:
    """What travelled beside a message, as far as it can be a seal."""
    beside = sample.attachment
    return bytes(beside) if beside is not None and len(beside) == SEAL_BYTES else b""
