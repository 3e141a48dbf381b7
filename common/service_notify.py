"""What a process reports to systemd where it runs as a unit of `Type=notify`: ready, alive, ending (sd_notify(3)).

`from_environment` -> `ready` once the nodes have their buses, `stepped` after every step, `stopping` when it ends. The
nodes' own loops keep the watchdog quiet: whichever of them gets stuck, systemd restarts the process.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterable
from contextlib import suppress

ADDRESS = "NOTIFY_SOCKET"
WATCHDOG_PERIOD_S = 1.0  # at most so often; the units' WatchdogSec is several times as long


class ServiceNotifier:
    """Datagrams to systemd. Nobody waits for it, and what it does not take is lost."""

    def __init__(self, nodes: Iterable[str], address: str) -> None:
        self._nodes = frozenset(nodes)
        self._missing = set(self._nodes)  # have not stepped since the watchdog was fed
        self._due_s = float("-inf")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def ready(self) -> None:
        self._send(b"READY=1")

    def stepped(self, node: str) -> None:
        """Feeds the watchdog, if all nodes have stepped since it was fed. Called by each node's own thread."""
        self._missing.discard(node)
        if not self._missing and (now_s := time.monotonic()) >= self._due_s:
            self._due_s, self._missing = now_s + WATCHDOG_PERIOD_S, set(self._nodes)
            self._send(b"WATCHDOG=1")

    def stopping(self) -> None:
        self._send(b"STOPPING=1")

    def _send(self, message: bytes) -> None:
        with suppress(OSError):
            self._socket.sendto(message, self._address)


def from_environment(nodes: Iterable[str]) -> ServiceNotifier | None:
    """None where no systemd waits for this process. What it starts itself must not report in its place."""
    address = os.environ.pop(ADDRESS, "")
    return ServiceNotifier(nodes, address) if address else None
