"""Sessions of Zenoh and their configuration: who listens, who connects, with which certificate and rights.

Robot: comm is the router, on loopback and, with keys, on one TLS address; the modules beside it are peers on loopback
and keep their links when it goes. Laptop: the recorder is the router on loopback, and joins comm's over TLS; poi on its
own board joins that too, and the command center for its commands, so that a stop passes through nothing but comm. With
everything on one machine it is the same, without TLS. Modules that share comm's process share its session.

Peers know each other's addresses, and of two the later in NEIGHBOURS connects, again and again for as long as it takes.
Zenoh's own way to find neighbours (gossip) announces each only once: a link that is lost while both keep their router
would never come back.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import zenoh

from common import access
from common.config import Config
from common.keys import checked_folder
from common.messages.topics import CLOCK, STOP
from common.modules import ON_ROBOT
from common.zenoh_channel import BEHIND_RECORDER, COMMANDS, WIFI_LEASE_S, Channel, Mode

ROBOT_ROUTER = "comm"
LAPTOP_ROUTER = "recorder"  # the process that joins the laptop's others with the robot
ROUTER_NEIGHBOUR = {ROBOT_ROUTER: LAPTOP_ROUTER, LAPTOP_ROUTER: ROBOT_ROUTER}
# Peers on the robot, and who leads a shared clock: to them others connect. Each has an address of its own on loopback,
# at the port of the router beside it, so that several meshes go side by side
NEIGHBOURS = (*(name for name in ON_ROBOT if name != ROBOT_ROUTER), CLOCK.producer)
PEER_HOSTS = tuple(f"127.0.0.{i}" for i in range(2, 2 + len(NEIGHBOURS)))  # the routers have 127.0.0.1
_CLOSE_TIMEOUT_S = 1.0

_log = logging.getLogger(__name__)


def main_channel(name: str, mode: Mode, config: Config) -> Channel:
    """Of a process's session; raises StartError when its keys cannot serve."""
    mesh, robot = config.mesh, config.robot.name
    if mode == "router" and name != LAPTOP_ROUTER:
        rules = access.robot_rules(robot) if mesh.keys else None
        if not mesh.listen:
            return Channel("router", (mesh.router,), rules=rules)
        return Channel("router", (mesh.router, mesh.listen), keys=_keys(config, "robot"), rules=rules)
    away = bool(mesh.robot) and name in (*access.ROLES["pi"], *access.ROLES["laptop"])
    if mode == "router":
        if not away:
            return Channel("router", (mesh.laptop_router,), (mesh.router,))
        keys, rules = _keys(config, "laptop"), access.laptop_rules(robot)
        return Channel("router", (mesh.laptop_router,), (mesh.robot,), keys, rules)
    if away and (mode == "client" or name in access.ROLES["pi"]):
        return _straight_to_robot(name, name, mode, config)
    if mode == "client":
        return Channel("client", connect=(mesh.router,))
    return _beside_router(name, away, config)


def command_channel(name: str, mode: Mode, config: Config) -> Channel | None:
    """Of the session that carries nothing but commands; None for a process that publishes none."""
    if mode != "peer" or name != STOP.producer:
        return None
    if config.mesh.robot:
        return _straight_to_robot(name, COMMANDS.format(name), mode, config)
    return _beside_router(COMMANDS.format(name), False, config)


def lease_s(name: str, clock_lease_s: float) -> float:
    """How long the others wait for this process until they give it up (s); on the robot, as the clock requires.

    comm too is reached over a poor Wi-Fi: who waits less than it takes TCP to bring a whole batch there opens the link
    again and again, and never gets one.
    """
    near = name in ON_ROBOT and name != ROBOT_ROUTER
    return clock_lease_s if near else max(clock_lease_s, WIFI_LEASE_S)


def _beside_router(session: str, on_laptop: bool, config: Config) -> Channel:
    """A peer's, on loopback: it connects to the router, and on the robot to the NEIGHBOURS before it."""
    if on_laptop or session in BEHIND_RECORDER:
        return Channel("peer", connect=(config.mesh.laptop_router,), region=session)
    router = config.mesh.router
    if session == STOP.producer:
        return Channel("peer", connect=(router,), region=session)
    port = router.rpartition(":")[2]
    addresses = {name: f"tcp/{host}:{port}" for name, host in zip(NEIGHBOURS, PEER_HOSTS, strict=True)}
    own = addresses.get(session)
    before = NEIGHBOURS[: NEIGHBOURS.index(session)] if own else NEIGHBOURS
    # Who shares the router's process has no session besides
    there = [name for name in before if config.process_of(name) != config.process_of(ROBOT_ROUTER)]
    return Channel("peer", (own,) if own else (), (router, *(addresses[name] for name in there)))


def _straight_to_robot(name: str, session: str, mode: Mode, config: Config) -> Channel:
    keys = _keys(config, access.role_of(name))
    return Channel(mode, connect=(config.mesh.robot,), keys=keys, region="" if mode == "client" else session)


def _keys(config: Config, role: str) -> Path:
    return checked_folder(Path(config.mesh.keys), role)


def direct(function: Callable[[Any], None]) -> Any:
    """A handler on Zenoh's own thread: a Python thread per subscriber would have to be joined before the end."""
    return zenoh.handlers.Callback(function, indirect=False)


def close_sessions(sessions: Iterable[zenoh.Session]) -> bool:
    """Closes each once; False when Zenoh is not done yet.

    It waits seconds for a frozen neighbour to take the farewell: the lease ends that link as well, so it is left.
    """
    closers = [
        threading.Thread(target=_close, args=(session,), daemon=True)
        for session in {id(s): s for s in sessions}.values()
    ]
    for closer in closers:
        closer.start()
    deadline_s = time.monotonic() + _CLOSE_TIMEOUT_S
    for closer in closers:
        closer.join(max(0.0, deadline_s - time.monotonic()))
    return not any(closer.is_alive() for closer in closers)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]
