"""Links of Zenoh: whoever closes one is held up by nobody."""

from __future__ import annotations

import os
import socket
import struct
import time
from contextlib import suppress

import pytest
import zenoh

from common.zenoh_session import Channel, _address, let_go_at_once, session_config
from deploy.local.ports import reserve_port


def lingering(port: int) -> list[int]:
    """For how many seconds each connected socket at a port may hold up whoever closes it."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            link = socket.socket(fileno=int(name))
            try:
                if port in (link.getsockname()[1], link.getpeername()[1]):
                    on, seconds = struct.unpack("ii", link.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                    found.append(seconds if on else 0)
            finally:
                link.detach()
    return found


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_closing_a_link_waits_for_nobody(host: str) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, 0), family=family).close()
    except OSError:
        pytest.skip(f"this machine has no {host}")
    port = reserve_port()
    endpoint = f"tcp/[{host}]:{port}" if ":" in host else f"tcp/{host}:{port}"
    with (
        zenoh.open(session_config(Channel("router", (endpoint,)))) as router,
        zenoh.open(session_config(Channel("client", (), (endpoint,)))) as client,
    ):
        assert any(lingering(port))
        kept = [let_go_at_once(session) for session in (router, client)]
        end_s = time.monotonic() + 10.0
        while any(lingering(port)):
            assert time.monotonic() < end_s
            time.sleep(0.01)
        del kept


def test_a_link_to_an_address_of_one_interface_is_found() -> None:
    assert _address("tcp/[fe80::1%4]:7447") == ("fe80::1", 7447)
    assert _address("tls/10.0.0.2:7449") == ("10.0.0.2", 7449)
