"""ZenohBus on loopback: the same answers as LocalBus, and what only sessions can do wrong."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
import zenoh

from common import bundle
from common.clock import Announcements, FreeClock
from common.config import Config, MeshSection, apart
from common.errors import StartError
from common.messages.health import Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate
from common.messages.mission import Operation, OperatorCommand
from common.messages.stop import Permit, StopRequest
from common.messages.topics import GRID, MAP, OPERATION, PERMIT, POSE, STATUS, STOP, Topic
from common.zenoh_bus import LOST_S, ZenohBus
from common.zenoh_channel import Channel, session_config
from common.zenoh_session import direct
from deploy.local.ports import reserve_port

pytestmark = pytest.mark.timeout(30)


def until(condition: Callable[[], bool], deadline_s: float = 20.0) -> None:
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s, "the condition did not come true in time"
        time.sleep(0.005)


Open = Callable[..., ZenohBus]


@pytest.fixture
def config() -> Config:
    return apart(Config(mesh=MeshSection(router=f"tcp/127.0.0.1:{reserve_port()}")))


@pytest.fixture
def open_bus(config: Config) -> Iterator[Open]:
    buses: list[ZenohBus] = []

    def make(name: str, mode: Literal["peer", "client", "router"] = "peer") -> ZenohBus:
        buses.append(ZenohBus(name, config, FreeClock(), mode))
        return buses[-1]

    yield make
    for bus in buses:
        bus.close()


def status(heartbeat_count: int) -> Status:
    return Status(0.0, "RUN", 0, 1, True, heartbeat_count)


def pose() -> PoseEstimate:
    return PoseEstimate(0.0, 1.0, 2.0, 0.0, 0.0, 0.1, 0.1, 1)


def wall(start: int, count: int, revision: int = 1) -> MapUpdate:
    points = np.arange(start, start + count, dtype=np.float32).repeat(2).reshape(-1, 2)
    return MapUpdate(0.0, revision, start, points, np.zeros(count, dtype=np.uint8))


def grid(revision: int) -> GridUpdate:
    return GridUpdate(0.0, revision, 0.0, 0.0, 0.05, 1, 1, b"x")


def test_newest_message_arrives_with_its_age(open_bus: Open) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("planner")
    assert receiver.latest(STATUS["mmu"]) is None
    assert receiver.age_s(STATUS["mmu"]) == float("inf")

    def arrived() -> bool:
        sender.publish(STATUS["mmu"], status(7))
        return receiver.latest(STATUS["mmu"]) == status(7)

    until(arrived)
    assert receiver.age_s(STATUS["mmu"]) < 0.5


def test_take_gives_everything_once_and_in_order(open_bus: Open) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("planner")
    receiver.take(STATUS["mmu"])

    def linked() -> bool:
        sender.publish(STATUS["mmu"], status(0))
        return receiver.latest(STATUS["mmu"]) is not None

    until(linked)
    for heartbeat_count in range(1, 101):
        sender.publish(STATUS["mmu"], status(heartbeat_count))
    got: list[int] = []

    def all_there() -> bool:
        got.extend(s.heartbeat_count for s in receiver.take(STATUS["mmu"]))
        return bool(got) and got[-1] == 100

    until(all_there)
    assert [b for b in got if b] == list(range(1, 101))
    assert receiver.take(STATUS["mmu"]) == []


def test_late_joiner_gets_the_newest_state_and_the_whole_map(open_bus: Open) -> None:
    open_bus("comm", "router")
    sender = open_bus("mmu")
    for update in (wall(0, 5), wall(0, 3, revision=2), wall(3, 2, revision=2), wall(5, 1, revision=2)):
        sender.publish(MAP, update)
    for revision in (1, 2):
        sender.publish(GRID, grid(revision))
    late = open_bus("observer")
    updates = late.take(MAP)

    def whole() -> bool:
        updates.extend(late.take(MAP))
        return len(updates) >= 3

    until(whole)
    assert [(u.revision, u.start) for u in updates] == [(2, 0), (2, 3), (2, 5)]
    until(lambda: late.latest(GRID) == grid(2))


class _AnsweredAtOnce:
    """A session whose questions are answered before `get` returns, as where its thread had to wait for a processor."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def get(self, key: str, handler: Any, **options: Any) -> None:
        done = threading.Event()

        def finished() -> None:
            handler.drop()
            done.set()

        own = zenoh.handlers.Callback(handler.callback, finished, indirect=False)
        self._session.get(key, own, **options)
        assert done.wait(5.0)


def test_a_map_that_comes_within_the_first_take_is_whole(open_bus: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    open_bus("comm", "router")
    sender, late = open_bus("mmu"), open_bus("witness")
    for update in (wall(0, 3), wall(3, 2)):
        sender.publish(MAP, update)
    # A token is no sign that the publisher may be asked by now: its queryable travels on its own
    until(lambda: any(reply.ok for reply in late._end.session.get(late._end.key(MAP))))
    monkeypatch.setattr(late._end, "session", _AnsweredAtOnce(late._end.session))
    assert [update.start for update in late.take(MAP)] == [0, 3]
    monkeypatch.undo()


def test_missed_increments_are_queried(open_bus: Open, config: Config) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("observer")
    starts: list[int] = []
    receiver.take(MAP)

    def got(start: int) -> bool:
        starts.extend(u.start for u in receiver.take(MAP))
        return start in starts

    sender.publish(MAP, wall(0, 1))
    until(lambda: got(0))
    # The receiver's subscription is away for a while, as in a cut link that comes back
    subscriptions, inbox = receiver._end._read, receiver._inboxes[MAP.key]
    subscriptions._subscribers.pop(MAP.key).undeclare()
    sender.publish(MAP, wall(1, 1))
    subscriptions.add(MAP, inbox)

    def live() -> bool:
        return got(3)

    sender.publish(MAP, wall(2, 1))
    time_out = time.monotonic() + 5
    start = 3
    while not live():
        assert time.monotonic() < time_out
        sender.publish(MAP, wall(start, 1))
        start += 1
        time.sleep(0.02)
    assert sorted(set(starts)) == list(range(max(starts) + 1))
    assert starts == sorted(starts)


@pytest.mark.parametrize(("topic", "first", "last"), [(MAP, wall(0, 1), wall(1, 1)), (GRID, grid(1), grid(2))])
def test_the_last_message_of_all_is_missed_by_nobody_and_silence_costs_nothing(
    open_bus: Open, monkeypatch: pytest.MonkeyPatch, topic: Topic[Any], first: Any, last: Any
) -> None:
    monkeypatch.setattr("common.zenoh_inbox._SILENCE_S", 0.2)
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("observer")
    got: list[Any] = []

    def count() -> int:
        got.extend(receiver.take(topic))
        return len(got)

    sender.publish(topic, first)
    until(lambda: count() == 1)
    # The receiver's subscription is away for a moment, as while a router is restarted
    subscriptions, inbox = receiver._end._read, receiver._inboxes[topic.key]
    subscriptions._subscribers.pop(topic.bundle_key or topic.key).undeclare()
    sender.publish(topic, last)
    subscriptions.add(topic, inbox)
    until(lambda: count() == 2)
    replies: list[list[bytes]] = []
    monkeypatch.setattr(sender._replies, "refuses", lambda _, messages: replies.append(messages))
    until(lambda: count() == 2 and len(replies) > 2)
    assert not any(replies)


def starts_of(receiver: ZenohBus, count: int) -> list[int]:
    """Where the first so many increments of the map begin, as they are taken."""
    starts: list[int] = []

    def enough() -> bool:
        starts.extend(update.start for update in receiver.take(MAP))
        return len(starts) >= count

    until(enough)
    return starts


def test_a_query_that_nobody_replied_to_makes_no_increment_whole(open_bus: Open) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("observer")
    sender.publish(MAP, wall(0, 1))
    assert starts_of(receiver, 1) == [0]
    subscriptions, inbox = receiver._end._read, receiver._inboxes[MAP.key]
    subscriptions._subscribers.pop(MAP.key).undeclare()
    sender.publish(MAP, wall(1, 1))
    # Nobody is reached while a router is restarted
    outbox = sender._outboxes[MAP.key]
    outbox._queryable.undeclare()
    inbox.publisher_appears()
    until(lambda: receiver.take(MAP) == [] and not (inbox._query_due or inbox._query_running))
    subscriptions.add(MAP, inbox)
    time.sleep(0.5)  # until the sender knows of the subscription
    sender.publish(MAP, wall(2, 1))
    end_s = time.monotonic() + 1.0
    while time.monotonic() < end_s:
        assert receiver.take(MAP) == []
        time.sleep(0.01)
    key = sender._end.key(MAP)
    outbox._queryable = sender._end.session_for(MAP).declare_queryable(key, direct(outbox._reply))
    assert starts_of(receiver, 2) == [1, 2]


def slow_replies(sender: ZenohBus, monkeypatch: pytest.MonkeyPatch, delay_s: float) -> None:
    monkeypatch.setattr(sender._replies, "refuses", lambda *_: time.sleep(delay_s))


def test_a_map_whose_reply_takes_longer_than_the_pause_between_queries_is_taken(
    open_bus: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_bus("comm", "router")
    sender, late = open_bus("mmu"), open_bus("observer")
    slow_replies(sender, monkeypatch, 0.4)
    for update in (wall(0, 3), wall(3, 2)):
        sender.publish(MAP, update)
    assert starts_of(late, 2) == [0, 3]


def test_queries_of_silence_that_nobody_answers_in_time_hold_up_no_live_message(
    open_bus: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("observer")
    sender.publish(MAP, wall(0, 1))
    until(lambda: receiver.latest(MAP) is not None)
    monkeypatch.setattr("common.zenoh_inbox._SILENCE_S", 0.05)
    monkeypatch.setattr("common.zenoh_inbox.QUERY_TIMEOUT_S", 0.2)
    # Later than the timeout; longer ones would take all of Zenoh's threads, which both ends share here
    slow_replies(sender, monkeypatch, 0.3)
    end_s = time.monotonic() + 1.0
    while time.monotonic() < end_s:
        receiver.latest(MAP)
        time.sleep(0.01)
    for start in range(1, 6):
        sender.publish(MAP, wall(start, 1))
        sent_s = time.monotonic()
        until(lambda start=start: receiver.latest(MAP).start == start)  # type: ignore[misc]
        assert time.monotonic() - sent_s < 0.5


def test_a_query_that_is_refused_is_repeated(open_bus: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    open_bus("comm", "router")
    sender = open_bus("mmu")
    refusals = [True, True]
    monkeypatch.setattr(sender._replies, "refuses", lambda *_: bool(refusals) and refusals.pop())
    for update in (wall(0, 3), wall(3, 2)):
        sender.publish(MAP, update)
    late = open_bus("witness")
    assert starts_of(late, 2) == [0, 3]
    assert not refusals


def test_a_snapshot_is_taken_though_every_question_is_refused(open_bus: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    open_bus("comm", "router")
    sender, planner = open_bus("mmu"), open_bus("planner")
    monkeypatch.setattr(sender._replies, "refuses", lambda *_: True)
    sender.publish(GRID, grid(1))
    until(lambda: any(reply.err for reply in planner._end.session.get(planner._end.key(GRID))))

    def newest() -> bool:
        sender.publish(GRID, grid(2))
        return planner.latest(GRID) == grid(2)

    until(newest)


def test_token_goes_when_a_process_leaves(open_bus: Open) -> None:
    comm, mmu = open_bus("comm", "router"), open_bus("mmu")
    until(lambda: {"comm", "mmu"} <= comm.alive_tokens())
    mmu.close()
    until(lambda: "mmu" not in comm.alive_tokens())


def test_stop_has_a_connection_of_its_own_and_arrives(open_bus: Open) -> None:
    comm, bridge, centre = open_bus("comm", "router"), open_bus("bridge"), open_bus("command_center")
    assert centre._end.command_session is not centre._end.session
    request = StopRequest(0.0, "operator", latched=True)

    def both() -> bool:
        centre.publish(STOP, request)
        return comm.latest(STOP) == request and bridge.latest(STOP) == request

    until(both)


def test_everybody_who_obeys_or_watches_hears_an_operation_of_the_command_center(open_bus: Open) -> None:
    open_bus("comm", "router")
    open_bus("recorder", "router")
    planner, local, centre = open_bus("planner"), open_bus("local"), open_bus("command_center")
    command = OperatorCommand(0.0, Operation.PAUSE)

    def heard() -> bool:
        centre.publish(OPERATION, command)
        return all(bus.latest(OPERATION) == command for bus in (planner, local))

    until(heard)


def test_peers_keep_each_other_when_the_router_goes(open_bus: Open) -> None:
    comm, mmu, planner = open_bus("comm", "router"), open_bus("mmu"), open_bus("planner")

    def heard(heartbeat_count: int) -> Callable[[], bool]:
        def condition() -> bool:
            mmu.publish(STATUS["mmu"], status(heartbeat_count))
            newest = planner.latest(STATUS["mmu"])
            return newest is not None and newest.heartbeat_count == heartbeat_count

        return condition

    until(heard(1))
    until(lambda: "planner" in mmu.alive_tokens())
    comm.close()
    until(heard(2), 1.0)
    assert "planner" in mmu.alive_tokens()


def test_a_peer_needs_no_router_to_begin_and_finds_it_later(open_bus: Open) -> None:
    mmu = open_bus("mmu")
    comm = open_bus("comm", "router")
    until(lambda: "mmu" in comm.alive_tokens())
    until(lambda: "comm" in mmu.alive_tokens())


def test_a_client_reaches_the_peers_through_the_router(open_bus: Open) -> None:
    open_bus("comm", "router")
    bridge, operator = open_bus("bridge"), open_bus("command_center", "client")
    request = StopRequest(0.0, "operator", latched=True)

    def arrived() -> bool:
        operator.publish(STOP, request)
        return bridge.latest(STOP) == request

    until(arrived)

    def permit_heard() -> bool:
        bridge.publish(PERMIT, Permit(0.0, True, ""))
        return operator.latest(PERMIT) is not None

    until(permit_heard)


def test_a_client_without_a_mesh_says_so(open_bus: Open) -> None:
    with pytest.raises(StartError, match="No mesh answers at tcp/127"):
        open_bus("command_center", "client")


def test_a_taken_port_is_named(open_bus: Open) -> None:
    open_bus("comm", "router")
    with pytest.raises(StartError, match="Cannot listen on tcp/127"):
        open_bus("comm", "router")


def test_bytes_that_are_no_message_are_counted_and_do_not_look_fresh(open_bus: Open, config: Config) -> None:
    open_bus("comm", "router")
    planner = open_bus("planner")
    planner.latest(POSE)
    with zenoh.open(session_config(Channel("client", connect=(config.mesh.router,)))) as stranger:

        def counted() -> bool:
            junk = bundle.pack([(POSE.key, b"\xc1 no message", True)])
            stranger.put(f"{config.robot.name}/{POSE.bundle_key}", junk)
            planner.latest(POSE)
            return planner.decode_errors.get(POSE.key, 0) > 0

        until(counted)
    assert planner.age_s(POSE) == float("inf")


def test_what_nobody_would_take_is_not_sent_and_the_sender_says_so(
    open_bus: Open, caplog: pytest.LogCaptureFixture
) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("planner")

    def arrived() -> bool:
        sender.publish(POSE, replace(pose(), x_m=float("nan")))
        sender.publish(POSE, pose())
        return receiver.latest(POSE) == pose()

    until(arrived)
    assert receiver.decode_errors == {}
    assert "not published topic=mmu/pose error=field 'x_m' must not be nan count=1" in caplog.messages


def test_what_was_announced_is_waited_for_and_what_is_lost_is_not_waited_for_long(open_bus: Open) -> None:
    open_bus("comm", "router")
    sender, receiver = open_bus("mmu"), open_bus("planner")
    sender.announced, expected = Announcements(), Announcements()

    def linked() -> bool:
        sender.publish(STATUS["mmu"], status(0))
        return receiver.latest(STATUS["mmu"]) is not None

    until(linked)
    for heartbeat_count in range(1, 50):
        sender.publish(STATUS["mmu"], status(heartbeat_count))
        sender.publish(POSE, pose())
        expected.merge(sender.announced.take())
        receiver.await_messages(expected, threading.Event())
        assert receiver._inboxes[STATUS["mmu"].key].newest == status(heartbeat_count)
    boot_id = next(iter(receiver._inboxes[STATUS["mmu"].key].sequences))
    expected.note(STATUS["mmu"].key, boot_id, 1_000_000)
    began_s = time.monotonic()
    receiver.await_messages(expected, threading.Event())
    assert time.monotonic() - began_s < LOST_S + 0.5
