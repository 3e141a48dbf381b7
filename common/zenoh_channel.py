"""How one session of Zenoh joins the mesh: its channel, Zenoh's configuration for that, and its opening.

Loads next to nothing, for a stop waits for it (`offboard/operate/stop_at_once.py`). Who has which channel:
`zenoh_session`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from common.config import Config
from common.constants import FREE_LEASE_S
from common.errors import StartError
from common.keys import AUTHORITY, CERTIFICATE, PRIVATE_KEY, checked_folder
from common.modules import COMMANDER, OFFBOARD, Board, on

Mode = Literal["peer", "client", "router"]

MESSAGE_BYTES_MAX = 16_000_000  # no message of ours is longer; a longer one is dropped unseen
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
COMMANDS = "{} commands"  # the name of the session that carries nothing else
# They reach the robot through the recorder's router, also where all is on one machine; who stops it does not depend on
# that
BEHIND_RECORDER = (*(name for name in OFFBOARD if name != COMMANDER), "simulator", "local")
# Sessions that reach others only through a router: it passes nothing between peers but from one region to another, so
# each of these is a region by itself. As clients they could not begin without the router. As routers they would receive
# no declarations when they are back too soon: trees of routes, computed at most every 100 ms, would not show it
_REGIONS = (*BEHIND_RECORDER, COMMANDER, COMMANDS.format(COMMANDER), *on(Board.RASPBERRY))


@dataclass(frozen=True, slots=True)
class Channel:
    """How a session joins the mesh."""

    mode: Mode
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    keys: Path | None = None  # folder of the certificate that it shows, for TLS
    rules: dict[str, Any] | None = None
    region: str = ""  # of a peer that reaches others only through a router


def commander_channel(config: Config) -> Channel:
    """Of a client with the rights of the command center; raises StartError when its keys cannot serve."""
    mesh = config.mesh
    if not mesh.robot:
        return Channel("client", connect=(mesh.router,))
    return Channel("client", connect=(mesh.robot,), keys=checked_folder(Path(mesh.keys), COMMANDER))


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


def put_command(session: zenoh.Session, key: str, data: bytes) -> None:
    """As a command travels; nothing waits for a link that is full."""
    session.put(key, data, priority=zenoh.Priority.REAL_TIME, congestion_control=zenoh.CongestionControl.DROP)
