"""Links of Zenoh: whoever closes one is held up by nobody."""

from __future__ import annotations

import os
import socket
import struct
import time
from contextlib import suppress

import pytest
import zenoh

from common.zenoh_session import Channel, let_go_at_once, session_config
from deploy.local.ports import reserve_port


def lingering() -> list[int]:
    """Of this process's connected sockets, for how many seconds each may hold up whoever closes it."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            link = socket.socket(fileno=int(name))
            try:
                link.getpeername()
                on, seconds = struct.unpack("ii", link.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                found.append(seconds if on else 0)
            finally:
                link.detach()
    return found


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]"])
def test_closing_a_link_waits_for_nobody(host: str) -> None:
    endpoint = f"tcp/{host}:{reserve_port()}"
    with (
        zenoh.open(session_config(Channel("router", (endpoint,)))) as router,
        zenoh.open(session_config(Channel("client", (), (endpoint,)))) as client,
    ):
        assert any(lingering())
        kept = [let_go_at_once(session) for session in (router, client)]
        end_s = time.monotonic() + 10.0
        while any(lingering()):
            assert time.monotonic() < end_s
            time.sleep(0.01)
        del kept
