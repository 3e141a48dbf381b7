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

import json
import logging
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from common import access
from common.clock import FREE_LEASE_S
from common.config import Config
from common.errors import StartError
from common.keys import AUTHORITY, CERTIFICATE, PRIVATE_KEY, checked_folder
from common.messages.topics import CLOCK, STOP
from common.modules import OFFBOARD, ON_ROBOT, Board, on
from common.recording import MESSAGE_BYTES_MAX

Mode = Literal["peer", "client", "router"]

ROBOT_ROUTER = "comm"
LAPTOP_ROUTER = "recorder"  # the process that joins the laptop's others with the robot
ROUTER_NEIGHBOUR = {ROBOT_ROUTER: LAPTOP_ROUTER, LAPTOP_ROUTER: ROBOT_ROUTER}
# With the robot's shorter lease, a link over a poor Wi-Fi would be given up before its handshake is complete
WIFI_LEASE_S = 2.0
# A lost first packet would block the attempt for the default of ten seconds: TCP repeats it ever more rarely
_OPEN_TIMEOUT_S = 2.5
# A thread that has to wait for a link that takes nothing holds up all others meanwhile, the robot's own among them: it
# must be done within a lease. What is longer than a queue would wait even for a link that is only slow
_BLOCKED_S = 0.1
_ANSWER_QUEUE = 16  # batches of 64 kB, enough for an answer of RECENT_BYTES
# Collected piece by piece before anybody may judge it: what a message is beside its payload is much less
_TRANSPORTED_BYTES_MAX = MESSAGE_BYTES_MAX + 64_000
_COMMANDS = "{} commands"  # the name of the session that carries nothing else
# Peers on the robot, and who leads a shared clock: to them others connect. Each has an address of its own on loopback,
# at the port of the router beside it, so that several meshes go side by side
NEIGHBOURS = (*(name for name in ON_ROBOT if name != ROBOT_ROUTER), CLOCK.producer)
PEER_HOSTS = tuple(f"127.0.0.{i}" for i in range(2, 2 + len(NEIGHBOURS)))  # the routers have 127.0.0.1
# They reach the robot through the recorder's router, also where all is on one machine; who stops it does not depend on
# that
_BEHIND_RECORDER = (*(name for name in OFFBOARD if name != STOP.producer), "simulator", "local")
# Sessions that reach others only through a router: it passes nothing between peers but from one region to another, so
# each of these is a region by itself. As clients they could not begin without the router. As routers they would receive
# no declarations when they are back too soon: trees of routes, computed at most every 100 ms, would not show it
_REGIONS = (*_BEHIND_RECORDER, STOP.producer, _COMMANDS.format(STOP.producer), *on(Board.RASPBERRY))
_CLOSE_TIMEOUT_S = 1.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Channel:
    """How a session joins the mesh."""

    mode: Mode
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    keys: Path | None = None  # folder of the certificate that it shows, for TLS
    rules: access.Rules | None = None
    region: str = ""  # of a peer that reaches others only through a router


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
        return _straight_to_robot(name, _COMMANDS.format(name), mode, config)
    return _beside_router(_COMMANDS.format(name), False, config)


def lease_s(name: str, clock_lease_s: float) -> float:
    """How long the others wait for this process until they give it up (s); on the robot, as the clock requires.

    comm too is reached over a poor Wi-Fi: who waits less than it takes TCP to bring a whole batch there opens the link
    again and again, and never gets one.
    """
    near = name in ON_ROBOT and name != ROBOT_ROUTER
    return clock_lease_s if near else max(clock_lease_s, WIFI_LEASE_S)


def _beside_router(session: str, on_laptop: bool, config: Config) -> Channel:
    """A peer's, on loopback: it connects to the router, and on the robot to the NEIGHBOURS before it."""
    if on_laptop or session in _BEHIND_RECORDER:
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


def session_config(channel: Channel, lease_s: float = FREE_LEASE_S) -> zenoh.Config:
    """What every session of the mesh shares. Multicast and shared memory fail in containers, hence neither."""
    values: dict[str, Any] = {
        "mode": channel.mode,
        "listen/endpoints": channel.listen,
        "connect/endpoints": channel.connect,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 100,  # ms that opening may wait for the others; they are found later as well
        "transport/unicast/open_timeout": round(1000 * _OPEN_TIMEOUT_S),
        "transport/link/rx/max_message_size": _TRANSPORTED_BYTES_MAX,
        "transport/link/tx/lease": round(1000 * lease_s),
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/size/real_time": 16,
        "transport/link/tx/queue/size/data": _ANSWER_QUEUE,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": round(1e6 * _BLOCKED_S),
        "transport/shared_memory/enabled": False,
    }
    if channel.mode == "client":
        values |= {"connect/timeout_ms": 1500, "connect/exit_on_failure": True}
    if channel.region:
        values["region_name"] = channel.region
    if channel.mode == "router":
        regions = [{"region_names": [region]} for region in dict.fromkeys(_REGIONS)]
        values["gateway"] = {
            "south": [{"filters": [f]} for f in (*regions, {"modes": ["client"]}, {"modes": ["peer"]})]
        }
    if channel.keys is not None:
        values["transport/link/tls"] = _tls(channel.keys)
    if channel.rules is not None:
        values |= channel.rules
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls(keys: Path) -> dict[str, Any]:
    certificate, private_key = str(keys / CERTIFICATE), str(keys / PRIVATE_KEY)
    return {
        "root_ca_certificate": str(keys / AUTHORITY),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "listen_certificate": certificate,
        "listen_private_key": private_key,
        "connect_certificate": certificate,
        "connect_private_key": private_key,
    }


def open_session(channel: Channel, lease_s: float) -> zenoh.Session:
    """Raises StartError when an address to listen on is taken, and for a client when no router answers."""
    try:
        return zenoh.open(session_config(channel, lease_s))
    except zenoh.ZError as error:
        if channel.mode != "client":
            hint = "it is in use; stop the other mesh or program, or give this mesh another [mesh] router in robot.toml"
            raise StartError(f"Cannot listen on {' and '.join(channel.listen)}: {hint}.") from error
        hint = "start it, or correct [mesh] router in robot.toml"
        if channel.keys is not None:
            hint = f"is the robot on, and are its keys of the same authority as those in {channel.keys}?"
            raise StartError(f"No mesh answers at {channel.connect[0]}: {hint}") from error
        raise StartError(f"No mesh answers at {channel.connect[0]}: {hint}.") from error


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
