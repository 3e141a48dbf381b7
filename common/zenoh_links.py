"""The links of a session: who joins, that closing one waits for nothing, and that none stays deaf."""

from __future__ import annotations

import logging
import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import zenoh

from common import access
from common.zenoh_session import direct

_NO_LINGER = struct.pack("ii", 0, 0)
_DEAF_S = 10.0  # a poor radio takes seconds to bring what is declared to a new neighbour
_DEAF_MAX_S = 80.0

_log = logging.getLogger(__name__)


def watch_links(session: zenoh.Session) -> Any:
    """Logs who joins with a certificate, and whether the rules let it command; keep the handle."""
    return session.info.declare_link_events_listener(direct(_log_link))


def _log_link(event: zenoh.LinkEvent) -> None:
    role = event.link.auth_identifier
    if role is None:
        return
    if event.kind == zenoh.SampleKind.DELETE:
        _log.info("a machine has left certificate=%s", role)
    else:
        commands = "taken" if access.may_command(role) else "refused"
        _log.info("a machine has joined certificate=%s commands=%s", role, commands)


def let_go_at_once(session: zenoh.Session) -> Any:
    """Makes that closing a link waits for nothing; keep the handle.

    Zenoh has TCP wait up to ten seconds for what is not acknowledged (SO_LINGER), in a thread that others need: links
    of machines that are out of reach would hold up everybody else's.
    """
    return session.info.declare_link_events_listener(direct(_let_go_at_once), history=True)


def _let_go_at_once(event: zenoh.LinkEvent) -> None:
    if event.kind == zenoh.SampleKind.DELETE:
        return
    with _sockets_of(event.link) as sockets:
        for link in sockets:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)


class NeighbourWatch:
    """Of a router: cuts the link to its neighbour, another router, where it stands and nothing is declared over it.

    Zenoh computes its trees of routes at most every 100 ms, and declares subscribers, queryables and tokens only to who
    is new in them: over a link that went and came between two computations nothing comes any more, for good
    (findings/zenoh_router_returns.sh). A link that is opened anew later is sound.
    """

    def __init__(self, session: zenoh.Session, tokens: str) -> None:
        """`tokens`: key expression of the neighbour's liveliness tokens."""
        self._session = session
        self._present: set[str] = set()  # the neighbour's tokens
        self._wait_s = _DEAF_S
        self._timer: threading.Timer | None = None  # of the newest link
        liveliness = session.liveliness()
        self._handles = (
            liveliness.declare_subscriber(tokens, direct(self._on_token), history=True),
            session.info.declare_transport_events_listener(direct(self._on_transport), history=True),
        )

    def _on_token(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._present.discard(str(sample.key_expr))
        else:
            self._present.add(str(sample.key_expr))
            self._wait_s = _DEAF_S

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE or event.transport.whatami != zenoh.WhatAmI.ROUTER:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(self._wait_s, self._judge, (event.transport.zid,))
        self._timer.daemon = True
        self._timer.start()

    def _judge(self, neighbour: zenoh.ZenohId) -> None:
        with suppress(zenoh.ZError):  # the session was closed meanwhile
            links = [link for link in self._session.info.links() if link.zid == neighbour]
            if self._present or not links:
                return
            self._wait_s = min(2.0 * self._wait_s, _DEAF_MAX_S)
            _log.warning("nothing comes over the link to the other router; it is opened anew")
            for link in links:
                _cut(link)


def _cut(link: zenoh.Link) -> None:
    with _sockets_of(link) as sockets:
        for connected in sockets:
            with suppress(OSError):
                connected.shutdown(socket.SHUT_RDWR)


@contextmanager
def _sockets_of(link: zenoh.Link) -> Iterator[list[socket.socket]]:
    """The sockets of this process with the link's two ends; they stay Zenoh's."""
    ends = [_address(endpoint) for endpoint in (link.src, link.dst)]
    sockets = []
    for descriptor in _descriptors():
        with suppress(OSError):  # no socket, or none with another end
            found = socket.socket(fileno=descriptor)
            try:
                same = [found.getsockname()[:2], found.getpeername()[:2]] == ends
            except OSError:
                same = False
            if same:
                sockets.append(found)
            else:
                found.detach()
    try:
        yield sockets
    finally:
        for found in sockets:
            found.detach()


def _descriptors() -> list[int]:
    with suppress(OSError):
        return [int(name) for name in os.listdir("/proc/self/fd")]
    return []


def _address(endpoint: str) -> tuple[str, int]:
    """Of "tcp/127.0.0.1:7447", as Python's sockets have it."""
    host, _, port = endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
    return host.strip("[]").partition("%")[0], int(port)
