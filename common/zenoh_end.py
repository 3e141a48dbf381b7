"""One process's end of the mesh: its sessions, who of the nodes in it reads what, and what they publish.

A process may hold several nodes, each with a `ZenohBus` of its own on this end. What one publishes reaches the others
as it is; it is encoded once, for all who are elsewhere and for who records it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import zenoh

from common import bundle
from common.access import alive_key, alive_keys
from common.codec import DecodeError, Envelope
from common.command_gate import CommandGate
from common.config import Config
from common.messages.topics import Topic
from common.release import own_release
from common.signing import SIGNATURE_BYTES
from common.undecodable import Undecodable
from common.zenoh_channel import MESSAGE_BYTES_MAX, Mode, open_session
from common.zenoh_links import NeighbourWatch, let_go_at_once, watch_links
from common.zenoh_session import (
    ROUTER_NEIGHBOUR,
    close_sessions,
    command_channel,
    direct,
    main_channel,
)

_BUNDLE_PRIORITY = zenoh.Priority.REAL_TIME  # a drive command waits for nothing
# No publisher waits for a full link, or the robot would stand still: what is recorded and was dropped is queried again
CONGESTION = zenoh.CongestionControl.DROP


@dataclass(slots=True)
class Arrival:
    """One message as it came; whoever reads it first leaves what it decoded for the others of this process."""

    data: bytes
    signature: bytes = b""
    envelope: Envelope[Any] | None = None
    is_own: bool = False  # published by a node of this process
    news: bool = True  # no repeat of what was published before


class Reader(Protocol):
    """Who reads a topic. All are called by Zenoh's threads, or by a node that publishes: they must only store."""

    def store(self, arrival: Arrival) -> None: ...

    def has_come(self, *, news: bool) -> None:
        """Everything that came together is stored."""

    def count_bad(self, problem: str) -> None:
        """Something came on the topic that is no message."""


class Subscriptions:
    """Of one session: a subscriber per topic or bundle, however many nodes of the process read it."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._session, self._robot = session, robot
        self._readers: dict[str, list[Reader]] = {}
        self._subscribers: dict[str, Any] = {}
        self._lock = threading.Lock()  # of both tables
        self._bad_bundles = Undecodable("undecodable bundle")

    def add(self, topic: Topic[Any], reader: Reader) -> None:
        with self._lock:
            self._readers[topic.key] = [*self._readers.get(topic.key, ()), reader]
            key = topic.bundle_key or topic.key
            if key not in self._subscribers:
                receive = self._receive_bundle if topic.bundle_key else self._receive
                self._subscribers[key] = self._session.declare_subscriber(
                    f"{self._robot}/{key}", direct(partial(receive, key)), allowed_origin=zenoh.Locality.REMOTE
                )

    def deliver(self, messages: Iterable[tuple[str, Arrival]]) -> None:
        """To all who read the topics here; nobody is woken before everything is there."""
        came: dict[Reader, bool] = {}
        for topic_key, arrival in messages:
            for reader in self._readers.get(topic_key, ()):
                reader.store(arrival)
                came[reader] = came.get(reader, False) or arrival.news
        for reader, news in came.items():
            reader.has_come(news=news)

    def _receive(self, topic_key: str, sample: zenoh.Sample) -> None:
        if len(sample.payload) > MESSAGE_BYTES_MAX:
            for reader in self._readers[topic_key]:
                reader.count_bad(f"{len(sample.payload)} bytes are too many")
            return
        self.deliver([(topic_key, Arrival(bytes(sample.payload), _signature_of(sample)))])

    def _receive_bundle(self, bundle_key: str, sample: zenoh.Sample) -> None:
        try:
            if len(sample.payload) > MESSAGE_BYTES_MAX:
                raise DecodeError(f"{len(sample.payload)} bytes are too many")
            messages = bundle.unpack(bundle_key, bytes(sample.payload))
        except DecodeError as error:
            self._bad_bundles.count(bundle_key, str(error))
            return
        self.deliver((topic_key, Arrival(data, news=news)) for topic_key, data, news in messages)


class ZenohEnd:
    """The sessions of a process. Close it in `finally`: an open session keeps a dead process's token up.

    Raises StartError when a key is missing, when the router's port is taken, and in mode "client" when no router
    answers. A peer needs none.
    """

    def __init__(self, name: str, config: Config, mode: Mode, lease_s: float, nodes: Sequence[str] = ()) -> None:
        """`name`: whose sessions these are; `nodes`: of the process, where they are others or more."""
        self._robot = config.robot.name
        self.gates = {node: CommandGate(node, config) for node in nodes or (name,)}
        self._bundles: dict[str, Any] = {}  # publishers
        self._lock = threading.Lock()  # of that table
        main, commands = main_channel(name, mode, config), command_channel(name, mode, config)
        self.session = self.command_session = open_session(main, lease_s)
        self._read = self._read_commands = Subscriptions(self.session, self._robot)
        try:
            if commands is not None:
                self.command_session = open_session(commands, lease_s)
                self._read_commands = Subscriptions(self.command_session, self._robot)
            self._every = tuple(dict.fromkeys((self._read, self._read_commands)))
            self._link_watch = watch_links(self.session) if main.rules is not None else None
            sessions = (self.session,) if commands is None else (self.session, self.command_session)
            neighbour = ROUTER_NEIGHBOUR.get(name) if mode == "router" else None
            if neighbour is not None:
                tokens = f"{self._robot}/{alive_keys(neighbour)}"
                self._neighbour_watch = NeighbourWatch(self.session, tokens)
            self._letting_go = [let_go_at_once(session) for session in sessions]
        except BaseException:
            self.close()
            raise

    def close(self) -> bool:
        """Leaves the mesh; to be called once more does no harm. False when Zenoh is not done yet."""
        return close_sessions((self.command_session, self.session))

    def key(self, topic: Topic[Any]) -> str:
        """Where its messages are published one by one, and where its publisher is queried."""
        return f"{self._robot}/{topic.key}"

    def session_for(self, topic: Topic[Any]) -> zenoh.Session:
        return self.command_session if topic.is_command else self.session

    def declare_token(self, module: str) -> Any:
        """The module's liveliness token, for as long as the handle is kept."""
        return self.session.liveliness().declare_token(f"{self._robot}/{alive_key(module)}/{own_release().key}")

    def watch_tokens(self, receive: Callable[[zenoh.Sample], None]) -> Any:
        """Calls `receive` for every token that appears or goes; keep the handle."""
        keys = f"{self._robot}/{alive_keys('*')}"
        return self.session.liveliness().declare_subscriber(keys, direct(receive), history=True)

    def read(self, topic: Topic[Any], reader: Reader, *, as_command: bool = False) -> None:
        """From now on `reader` gets every message of the topic; `as_command`: over the session for commands."""
        (self._read_commands if as_command or topic.is_command else self._read).add(topic, reader)

    def deliver(self, topic_key: str, arrival: Arrival) -> None:
        """What a node of this process has published: to those beside it."""
        for subscriptions in self._every:
            subscriptions.deliver([(topic_key, arrival)])

    def put_bundle(self, bundle_key: str, messages: list[bundle.Packed]) -> None:
        with self._lock:
            publisher = self._bundles.get(bundle_key)
            if publisher is None:
                publisher = self.session.declare_publisher(
                    f"{self._robot}/{bundle_key}", priority=_BUNDLE_PRIORITY, congestion_control=CONGESTION
                )
                self._bundles[bundle_key] = publisher
        publisher.put(bundle.pack(messages))


def _signature_of(sample: zenoh.Sample) -> bytes:
    """What travelled beside a message, as far as it can be a signature."""
    beside = sample.attachment
    return bytes(beside) if beside is not None and len(beside) == SIGNATURE_BYTES else b""
