"""Messages as bytes, on their way into the run database: in order and once, with nothing missing that can be had.

A producer keeps its newest messages (`RecentMessages`). A `RecordingSubscriber` (of comm on the robot, of
the recorder on the laptop) knows by boot id and sequence number which messages it has not received and queries the
producer for them, also after its own restart.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import msgpack

from common.codec import DecodeError, read_header
from common.undecodable import Undecodable

RECENT_COUNT = 512
RECENT_BYTES = 1_000_000  # of each topic: three maps of a kilometre's drive
QUERY_BYTES_MAX = 4096  # KNOWN_BOOTS of them need a sixth of it
REPLY_COUNT_MAX = 100_000  # messages in one reply: two a second for half a day
RECORDING_QUEUE_LENGTH = 4096  # messages that may wait for the node's thread
KNOWN_BOOTS = 32  # restarts per topic that are remembered
HELD_MAX = 1024
_QUERY_PAUSE_S = 0.3
_AUDIT_PERIOD_S = 5.0
_GIVE_UP_S = 10.0  # wall time; a producer that has not replied until then is gone, and what it had with it

Known = dict[tuple[str, int], int]  # topic key and boot id -> newest sequence number
Losses = dict[tuple[str, int], tuple[int, int]]  # topic key and boot id -> from which to which number some were lost


class RecordedMessage(NamedTuple):
    """One message as it travelled, with the data of its envelope."""

    key: str
    boot_id: int
    sequence: int
    data: bytes


def remember(known: Known, source: tuple[str, int], sequence: int) -> None:
    """The newest number of a sender. Of each topic the KNOWN_BOOTS senders that published last are kept.

    One that is forgotten and publishes again counts as new; the database knows by their numbers which of its messages
    it has.
    """
    is_new = known.pop(source, None) is None
    known[source] = sequence
    if is_new:
        same_topic = [other for other in known if other[0] == source[0]]
        for forgotten in same_topic[:-KNOWN_BOOTS]:
            del known[forgotten]


def add_loss(losses: Losses, source: tuple[str, int], first: int, last: int) -> None:
    """Some of the messages from `first` to `last` are lost: which ones shows what is there."""
    low, high = losses.get(source, (first, last))
    losses[source] = min(low, first), max(high, last)


class RecentMessages:
    """The newest messages of one publisher, at most RECENT_COUNT and RECENT_BYTES, but always the newest one."""

    def __init__(self) -> None:
        self._messages: deque[tuple[int, bytes]] = deque()
        self._bytes = 0

    def append(self, sequence: int, data: bytes) -> None:
        self._messages.append((sequence, data))
        self._bytes += len(data)
        while len(self._messages) > 1 and (len(self._messages) > RECENT_COUNT or self._bytes > RECENT_BYTES):
            self._bytes -= len(self._messages.popleft()[1])

    def after(self, sequence: int) -> list[bytes]:
        return [data for number, data in self._messages if number > sequence]


@dataclass(slots=True)
class _Gap:
    since_s: float
    held: dict[int, RecordedMessage]  # what came from behind the gap


class MessageOrder:
    """Messages in any order -> each once and in order per topic and boot id. Pure; wall time is given."""

    def __init__(self, known: Mapping[tuple[str, int], int]) -> None:
        self.known: Known = dict(known)
        self._gaps: dict[tuple[str, int], _Gap] = {}
        self._lost: Losses = {}

    def add(self, message: RecordedMessage, now_s: float) -> list[RecordedMessage]:
        """What is in order now; a message from behind a gap is held until the gap is filled or given up."""
        source = (message.key, message.boot_id)
        newest = self.known.get(source, 0)
        if message.sequence <= newest:
            return []
        gap = self._gaps.get(source)
        if gap is None and message.sequence == newest + 1:
            remember(self.known, source, message.sequence)
            return [message]
        if gap is None:
            gap = self._gaps[source] = _Gap(now_s, {})
        gap.held[message.sequence] = message
        return self._drain(source, gap, max(gap.held) if len(gap.held) > HELD_MAX else 0)

    def cannot_be_had(self, source: tuple[str, int], up_to: int) -> list[RecordedMessage]:
        """The producer has sent all that it still had up to a sequence number: what is missing before it is lost."""
        gap = self._gaps.get(source)
        return self._drain(source, gap, up_to) if gap is not None else []

    def give_up(self, now_s: float) -> list[RecordedMessage]:
        """What is held behind gaps that nobody has filled for long."""
        old = [(source, gap) for source, gap in self._gaps.items() if now_s - gap.since_s > _GIVE_UP_S]
        return [message for source, gap in old for message in self._drain(source, gap, max(gap.held))]

    def topics_with_gaps(self) -> set[str]:
        return {key for key, _ in self._gaps}

    def boots(self, key: str) -> dict[int, int]:
        """Boot id -> newest sequence number known of a topic."""
        return {boot_id: sequence for (topic, boot_id), sequence in self.known.items() if topic == key}

    def take_lost(self) -> Losses:
        lost, self._lost = self._lost, {}
        return lost

    def _drain(self, source: tuple[str, int], gap: _Gap, up_to: int) -> list[RecordedMessage]:
        messages = []
        newest = self.known.get(source, 0)
        for sequence in sorted(gap.held):
            if sequence > newest + 1:
                if sequence > up_to:
                    break
                add_loss(self._lost, source, newest + 1, sequence - 1)
            messages.append(gap.held.pop(sequence))
            newest = sequence
        if messages:
            remember(self.known, source, newest)
        if not gap.held:
            del self._gaps[source]
        return messages


Query = Callable[[str, bytes], None]


class RecordingSubscriber:
    """Every message of some topics. `store` and `add_reply` are called by the bus's threads, the rest by the node's.

    `query(key, payload)` sends a query, `RecentMessages` reply to it; the replies come to `add_reply`.
    """

    def __init__(
        self,
        keys: Iterable[str],
        on_event: Iterable[str],
        known: Mapping[tuple[str, int], int],
        query: Query,
        wall_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`on_event`: the keys where no next message may come for long that would show a gap."""
        self._no_messages = Undecodable("no message")
        self.bad = self._no_messages.counts  # by topic key
        self._order = MessageOrder(known)
        self._query = query
        self._wall_s = wall_s
        self._keys, self._on_event = tuple(keys), frozenset(on_event)
        self._came: deque[tuple[str, bytes] | RecordedMessage] = deque(maxlen=RECORDING_QUEUE_LENGTH)
        self._replies: deque[tuple[str, bytes]] = deque()
        self._queried_s = dict.fromkeys(self._keys, float("-inf"))
        self._audit_due_s = float("-inf")
        self._all_due = threading.Event()
        self._all_due.set()

    def store(self, key: str, data: bytes) -> None:
        self._came.append((key, data))

    def store_own(self, message: RecordedMessage) -> None:
        """Of a node of this process."""
        self._came.append(message)

    def add_reply(self, key: str, pack: bytes) -> None:
        self._replies.append((key, pack))

    def query_all(self) -> None:
        """A producer has come, or come back: it may have published something meanwhile."""
        self._all_due.set()

    def messages(self) -> list[RecordedMessage]:
        """What came since the last call; queries what is missing."""
        now_s = self._wall_s()
        messages: list[RecordedMessage] = []
        while self._came:
            came = self._came.popleft()
            message = came if isinstance(came, RecordedMessage) else self._message(*came)
            if message is not None:
                messages += self._order.add(message, now_s)
        while self._replies:
            messages += self._fill(*self._replies.popleft(), now_s)
        messages += self._order.give_up(now_s)
        self._query_missing(now_s)
        return messages

    def take_lost(self) -> Losses:
        return self._order.take_lost()

    def _message(self, key: str, data: bytes) -> RecordedMessage | None:
        try:
            sequence, boot_id = read_header(data)
        except DecodeError as error:
            self.count_bad(key, str(error))
            return None
        return RecordedMessage(key, boot_id, sequence, data)

    def count_bad(self, key: str, problem: str) -> None:
        """What came is no message at all, so no database can hold it under its number."""
        self._no_messages.count(key, problem)

    def _fill(self, key: str, pack: bytes, now_s: float) -> list[RecordedMessage]:
        messages: list[RecordedMessage] = []
        newest: dict[int, int] = {}
        for data in unpack_messages(pack, RECENT_COUNT):
            message = self._message(key, data)
            if message is not None:
                messages += self._order.add(message, now_s)
                newest[message.boot_id] = max(newest.get(message.boot_id, 0), message.sequence)
        for boot_id, sequence in newest.items():
            messages += self._order.cannot_be_had((key, boot_id), sequence)
        return messages

    def _query_missing(self, now_s: float) -> None:
        due = self._order.topics_with_gaps()
        if self._all_due.is_set():
            self._all_due.clear()
            due |= set(self._keys)
            self._queried_s = dict.fromkeys(self._keys, float("-inf"))
        if now_s >= self._audit_due_s:
            self._audit_due_s = now_s + _AUDIT_PERIOD_S
            due |= self._on_event
        for key in sorted(due):
            if now_s - self._queried_s[key] >= _QUERY_PAUSE_S:
                self._queried_s[key] = now_s
                self._query(key, gap_query(self._order.boots(key)))


def gap_query(boots: Mapping[int, int]) -> bytes:
    """The query for everything after the newest sequence number known of its boot id."""
    packed: bytes = msgpack.packb(dict(boots))
    return packed


def queried_after(query: bytes, boot_id: int) -> int:
    """The newest sequence number that the sender of a query has of this boot; 0 where it has none or makes no sense."""
    try:
        boots = msgpack.unpackb(query, strict_map_key=False)
    except (ValueError, msgpack.UnpackException):
        return 0
    sequence = boots.get(boot_id, 0) if isinstance(boots, dict) else 0
    return sequence if isinstance(sequence, int) else 0


def unpack_messages(pack: bytes, count_max: int = REPLY_COUNT_MAX) -> list[bytes]:
    """The messages in a reply, or its first `count_max`; none when it makes no sense."""
    # One after the other: a list of lists of the same length would fill the memory
    unpacker = msgpack.Unpacker(max_buffer_size=max(1, len(pack)), max_array_len=0, max_map_len=0, max_ext_len=0)
    unpacker.feed(pack)
    try:
        count = min(unpacker.read_array_header(), count_max)
        messages = [unpacker.unpack() for _ in range(count)]
    except (ValueError, msgpack.UnpackException):
        return []
    return [message for message in messages if isinstance(message, bytes)]
