"""Messages on their way into the database: put in order, each once; what is missing is queried or counted."""

from __future__ import annotations

import random

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.codec import encode
from common.messages.health import Status
from common.messages.topics import POSE, STATUS
from common.recording import (
    RECENT_BYTES,
    RECENT_COUNT,
    MessageOrder,
    RecentMessages,
    RecordedMessage,
    RecordingSubscriber,
    gap_query,
    queried_after,
    unpack_messages,
)

KEY = STATUS["mmu"].key
BOOT = 7


def data(sequence: int, boot_id: int = BOOT) -> bytes:
    return encode(Status(0.0, "RUN", 0, 0, True, sequence), sequence, boot_id)


def message(sequence: int, boot_id: int = BOOT) -> RecordedMessage:
    return RecordedMessage(KEY, boot_id, sequence, data(sequence, boot_id))


@given(st.lists(st.integers(1, 20), max_size=60), st.randoms())
def test_messages_leave_in_order_and_once_however_they_come(sequences: list[int], shuffle: random.Random) -> None:
    order = MessageOrder({})
    came = [*sequences, *range(1, 21)]
    shuffle.shuffle(came)
    left = [f.sequence for sequence in came for f in order.add(message(sequence), 0.0)]
    assert left == list(range(1, 21))
    assert order.take_lost() == {}


@given(st.sets(st.integers(1, 40), min_size=1))
def test_what_came_and_what_was_lost_make_up_what_was_published(came: set[int]) -> None:
    order = MessageOrder({})
    left = [f.sequence for sequence in came for f in order.add(message(sequence), 0.0)]
    left += [f.sequence for f in order.give_up(1000.0)]
    assert left == sorted(came)
    first, last = order.take_lost().get((KEY, BOOT), (1, 0))
    assert set(range(first, last + 1)) >= set(range(1, max(came))) - came
    assert last < max(came)


def test_what_was_received_in_an_earlier_life_is_not_taken_again() -> None:
    order = MessageOrder({(KEY, BOOT): 5})
    assert order.add(message(5), 0.0) == []
    assert [f.sequence for f in order.add(message(6), 0.0)] == [6]


class Producer:
    """Keeps what it published, and replies."""

    def __init__(self) -> None:
        self.recent = RecentMessages()
        self.sequence = 0
        self.reachable = True

    def publish(self, recording: RecordingSubscriber | None = None) -> None:
        self.sequence += 1
        message = data(self.sequence)
        self.recent.append(self.sequence, message)
        if recording is not None:
            recording.store(KEY, message)


def recording_of(producer: Producer, known: dict[tuple[str, int], int], clock: list[float]) -> RecordingSubscriber:
    def query(key: str, payload: bytes) -> None:
        if producer.reachable:
            recording.add_reply(key, msgpack.packb(producer.recent.after(queried_after(payload, BOOT))))

    recording = RecordingSubscriber([KEY], [], known, query, lambda: clock[0])
    return recording


def sequences(recording: RecordingSubscriber, clock: list[float]) -> list[int]:
    found = []
    for _ in range(4):
        clock[0] += 0.5
        found += [f.sequence for f in recording.messages()]
    return found


def test_a_restarted_recording_subscriber_gets_what_was_published_while_it_was_away() -> None:
    producer, clock = Producer(), [0.0]
    for _ in range(30):
        producer.publish()
    recording = recording_of(producer, {(KEY, BOOT): 12}, clock)
    assert sequences(recording, clock) == list(range(13, 31))
    assert recording.take_lost() == {}


def test_a_hole_in_the_numbers_is_filled_by_the_producer() -> None:
    producer, clock = Producer(), [0.0]
    recording = recording_of(producer, {}, clock)
    producer.publish(recording)
    assert sequences(recording, clock) == [1]
    producer.publish()
    producer.publish(recording)
    assert sequences(recording, clock) == [2, 3]


def test_what_the_producer_no_longer_has_is_counted_as_lost() -> None:
    producer, clock = Producer(), [0.0]
    for _ in range(RECENT_COUNT + 10):
        producer.publish()
    recording = recording_of(producer, {(KEY, BOOT): 4}, clock)
    assert sequences(recording, clock) == list(range(11, RECENT_COUNT + 11))
    assert recording.take_lost() == {(KEY, BOOT): (5, 10)}


def test_a_producer_that_is_gone_is_not_waited_for_for_ever() -> None:
    producer, clock = Producer(), [0.0]
    recording = recording_of(producer, {}, clock)
    producer.publish(recording)
    producer.publish()
    producer.reachable = False
    producer.publish(recording)
    assert sequences(recording, clock) == [1]
    clock[0] += 60.0
    assert sequences(recording, clock) == [3]
    assert recording.take_lost() == {(KEY, BOOT): (2, 2)}


def test_what_is_no_message_is_counted() -> None:
    recording = RecordingSubscriber([KEY], [], {}, lambda key, query: None)
    for junk in (b"", b"\xc1", b"\x94\x01\x01", encode(Status(0.0, "", 0, 0, True, 1), 0, BOOT), b"\x00" * 500):
        recording.store(KEY, junk)
    recording.add_reply(KEY, b"\xff no list")
    assert recording.messages() == []
    assert recording.bad == {KEY: 5}


def test_history_is_bounded_but_holds_the_newest() -> None:
    recent = RecentMessages()
    for sequence in range(1, 2000):
        recent.append(sequence, b"x")
    assert len(recent.after(0)) == RECENT_COUNT
    recent.append(2000, bytes(RECENT_BYTES + 1))
    assert [len(m) for m in recent.after(0)] == [RECENT_BYTES + 1]


def test_a_query_names_the_newest_number_of_the_boot_that_is_queried() -> None:
    query = gap_query({BOOT: 12, 8: 3})
    assert (queried_after(query, BOOT), queried_after(query, 8), queried_after(query, 9)) == (12, 3, 0)
    assert queried_after(b"\xc1", BOOT) == 0
    assert POSE.recorded


@pytest.mark.parametrize("content", [[[]] * 1000, [{}], [[b"a"]], b"a", None, {}])
def test_a_reply_that_is_no_list_of_messages_is_none(content: object) -> None:
    pack = msgpack.packb(content)
    assert unpack_messages(pack) == []
    assert unpack_messages(pack[:-1]) == []


def test_of_an_endless_reply_only_the_beginning_is_read() -> None:
    assert unpack_messages(msgpack.packb([b"a"] * 1000), 3) == [b"a"] * 3
    assert unpack_messages(b"\xdd\xff\xff\xff\xff") == []
