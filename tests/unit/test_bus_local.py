"""Nodes in one program hear each other through a LocalMesh."""

from __future__ import annotations

from math import inf

import pytest

from common.bus import ALIVE_PERIODS, QUEUE_LENGTH, LocalBus, LocalMesh, alive, alive_and_valid
from common.messages.motion import Distances
from common.messages.stop import StopRequest
from common.messages.topics import DISTANCES, POSE, STOP


@pytest.fixture
def mesh() -> LocalMesh:
    return LocalMesh()


@pytest.fixture
def sender(mesh: LocalMesh) -> LocalBus:
    return mesh.endpoint("sender")


@pytest.fixture
def receiver(mesh: LocalMesh) -> LocalBus:
    return mesh.endpoint("receiver")


def distances(t_s: float, *, valid: bool = True) -> Distances:
    return Distances(t_s, 1.0, 2.0, 3.0, valid)


def test_nothing_came_yet(receiver: LocalBus) -> None:
    assert receiver.latest(DISTANCES) is None
    assert receiver.take(DISTANCES) == []
    assert receiver.age_s(DISTANCES) == inf
    assert not alive(receiver, DISTANCES)
    assert not alive_and_valid(receiver, DISTANCES)


def test_latest_is_the_newest_message_and_stays(sender: LocalBus, receiver: LocalBus) -> None:
    sender.publish(DISTANCES, distances(1.0))
    sender.publish(DISTANCES, distances(2.0))
    assert receiver.latest(DISTANCES) == receiver.latest(DISTANCES) == distances(2.0)


def test_take_gives_every_message_once_and_in_order(sender: LocalBus, receiver: LocalBus) -> None:
    receiver.take(DISTANCES)
    for t_s in (1.0, 2.0, 3.0):
        sender.publish(DISTANCES, distances(t_s))
    assert [message.t_s for message in receiver.take(DISTANCES)] == [1.0, 2.0, 3.0]
    assert receiver.take(DISTANCES) == []


def test_first_take_begins_with_the_newest(sender: LocalBus, receiver: LocalBus) -> None:
    sender.publish(DISTANCES, distances(1.0))
    sender.publish(DISTANCES, distances(2.0))
    assert receiver.take(DISTANCES) == [distances(2.0)]
    assert receiver.take(DISTANCES) == []


def test_full_queue_drops_the_oldest(sender: LocalBus, receiver: LocalBus) -> None:
    receiver.take(DISTANCES)
    for k in range(QUEUE_LENGTH + 5):
        sender.publish(DISTANCES, distances(float(k)))
    taken = receiver.take(DISTANCES)
    assert len(taken) == QUEUE_LENGTH
    assert taken[0].t_s == 5.0


def test_topics_do_not_mix(sender: LocalBus, receiver: LocalBus) -> None:
    sender.publish(STOP, StopRequest(1.0, "operator", True))
    assert receiver.latest(DISTANCES) is None
    assert receiver.latest(STOP) == StopRequest(1.0, "operator", True)


def test_receivers_do_not_take_from_each_other(mesh: LocalMesh, sender: LocalBus, receiver: LocalBus) -> None:
    other = mesh.endpoint("other")
    for bus in (receiver, other):
        bus.take(DISTANCES)
    sender.publish(DISTANCES, distances(1.0))
    assert receiver.take(DISTANCES) == other.take(DISTANCES) == [distances(1.0)]


def test_age_counts_from_arrival_on_the_receivers_clock(mesh: LocalMesh, sender: LocalBus, receiver: LocalBus) -> None:
    mesh.now_s = 10.0
    sender.publish(DISTANCES, distances(t_s=500.0))
    mesh.now_s = 10.25
    assert receiver.age_s(DISTANCES) == pytest.approx(0.25)


def test_input_is_dead_after_some_periods_of_silence(mesh: LocalMesh, sender: LocalBus, receiver: LocalBus) -> None:
    sender.publish(DISTANCES, distances(0.0))
    limit_s = ALIVE_PERIODS / DISTANCES.rate_hz
    mesh.now_s = limit_s - 0.01
    assert alive_and_valid(receiver, DISTANCES)
    mesh.now_s = limit_s + 0.01
    assert not alive_and_valid(receiver, DISTANCES)


def test_fresh_but_invalid_input_is_not_trusted(sender: LocalBus, receiver: LocalBus) -> None:
    sender.publish(DISTANCES, distances(0.0, valid=False))
    assert alive(receiver, DISTANCES)
    assert not alive_and_valid(receiver, DISTANCES)
    assert not alive(receiver, POSE)


def test_what_nobody_would_take_is_not_published_and_the_sender_says_so(
    sender: LocalBus, receiver: LocalBus, caplog: pytest.LogCaptureFixture
) -> None:
    receiver.record([DISTANCES], {})
    for left_m in (1.0, inf, -inf, 2.0):
        sender.publish(DISTANCES, Distances(1.0, left_m, 2.0, 3.0))
    assert [message.sequence for message in receiver.take_recorded()] == [1, 2], "no number is used up"
    assert receiver.latest(DISTANCES) == Distances(1.0, 2.0, 2.0, 3.0)
    assert caplog.messages == [
        "not published topic=bridge/distances error=field 'left_m' must not be inf count=1",
        "not published topic=bridge/distances error=field 'left_m' must not be -inf count=2",
    ]
