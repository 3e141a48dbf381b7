"""Ports on loopback for meshes, of which no two can share one.

A mesh listens at one port of several addresses (`zenoh_session.PEER_HOSTS`). Who takes a port for it binds that port of
ANCHOR_HOST too, where nothing listens, and keeps it until the process ends: the system gives it to nobody else
meanwhile, also while the processes of the mesh have not begun or are restarted.
"""

from __future__ import annotations

import random
import socket
import time
from contextlib import ExitStack

from common.clock import FreeClock
from common.config import Config, MeshSection
from common.errors import StartError
from common.zenoh_bus import ZenohBus
from common.zenoh_session import PEER_HOSTS

ANCHOR_HOST = "127.0.0.254"
PORTS = range(10_000, 32_000)  # below those that the system gives to outgoing connections
_TRIES = 1000
_TOKENS_S = 1.0

_anchors: list[socket.socket] = []


def usual_port() -> int:
    """Of the router: so that `estop` and the others need no configuration."""
    return int(MeshSection().router.rsplit(":", 1)[1])


def reserve_port(wanted: int | None = None) -> int:
    """The wanted port where it is free, else any; until this process ends it is given to no other mesh.

    Raises StartError when there is none.
    """
    others = random.SystemRandom().sample(PORTS, _TRIES)
    for port in others if wanted is None else [wanted, *others]:
        anchor = _reserved(port)
        if anchor is not None:
            _anchors.append(anchor)
            return port
    raise StartError("The loopback interface has no free port: end some programs, then start again.")


def _reserved(port: int) -> socket.socket | None:
    with ExitStack() as probes:
        anchor = socket.socket()
        try:
            anchor.bind((ANCHOR_HOST, port))
            for host in ("127.0.0.1", *PEER_HOSTS):
                probe = probes.enter_context(socket.socket())
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, port))
        except OSError:
            anchor.close()
            return None
        return anchor


def refuse_second_mesh(config: Config) -> None:
    """Raises StartError when a mesh of this robot's name answers where the configuration has its router.

    Two of one name would mix: commands and stops of one would reach the other.
    """
    try:
        bus = ZenohBus("local", config, FreeClock(), "client")
    except StartError:
        return
    try:
        deadline_s = time.monotonic() + _TOKENS_S
        while not bus.alive_tokens() and time.monotonic() < deadline_s:
            time.sleep(0.02)
        modules = bus.alive_tokens()
    finally:
        bus.close()
    if modules:
        raise StartError(
            f"A mesh of {config.robot.name} runs already at {config.mesh.router} ({', '.join(sorted(modules))}): "
            "end it first, or add --headless, which takes a port of its own."
        )
