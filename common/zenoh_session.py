"""Sessions of Zenoh and their configuration: who listens, who connects, how soon a silent neighbour counts as gone.

comm opens mode "router" on loopback, the others are peers that find each other through it (gossip) and keep their links
when it goes.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, Literal

import zenoh

from common.clock import FREE_LEASE_S
from common.errors import StartError

Mode = Literal["peer", "client", "router"]

LAPTOP_ROUTER = "recorder"  # the process that joins the laptop's others with the robot
_CLOSE_TIMEOUT_S = 1.0


def session_config(mode: Mode, router: str, lease_s: float = FREE_LEASE_S, beyond: str | None = None) -> zenoh.Config:
    """What every session of the loopback mesh shares. Multicast and shared memory fail in containers, hence neither.

    `router` is where a router listens and the others connect; `beyond` another router that this one connects to.
    """
    connect = ([beyond] if beyond else []) if mode == "router" else [router]
    values: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": {"router": [router], "peer": ["tcp/127.0.0.1:0"], "client": []}[mode],
        "connect/endpoints": connect,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "scouting/delay": 100,  # ms that opening may wait for the others; they are found later as well
        "transport/link/tx/lease": round(1000 * lease_s),
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/size/real_time": 16,
        "transport/shared_memory/enabled": False,
    }
    if mode == "client":
        values |= {"connect/timeout_ms": 1500, "connect/exit_on_failure": True}
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_session(mode: Mode, router: str, lease_s: float, beyond: str | None = None) -> zenoh.Session:
    """Raises StartError when the router's port is taken, and in mode "client" when no router answers."""
    try:
        return zenoh.open(session_config(mode, router, lease_s, beyond))
    except zenoh.ZError as error:
        if mode == "router":
            hint = "another mesh uses it; stop that one, or give this one another [mesh] router in robot.toml"
            raise StartError(f"Cannot listen on {router}: {hint}.") from error
        raise StartError(f"No mesh answers at {router}: start it, or correct [mesh] router in robot.toml.") from error


def close_sessions(sessions: Iterable[zenoh.Session]) -> bool:
    """Closes each once; False when Zenoh is not done yet.

    It waits 10 s for a frozen neighbour to take the farewell: the lease tells that one as well, so it is left.
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
