"""The relay that stands in for a Wi-Fi link."""

from __future__ import annotations

import socket
from contextlib import closing

from deploy.bench.relay import Relay
from deploy.local.ports import reserve_port


def test_who_connects_before_anybody_listens_behind_it_is_turned_away_and_the_next_is_passed_on() -> None:
    port = reserve_port()
    with closing(Relay(f"tcp/127.0.0.1:{port}")) as relay:
        here = "127.0.0.1", int(relay.endpoint.rpartition(":")[2])
        with socket.create_connection(here, timeout=5.0) as early:
            assert early.recv(1) == b""
        with socket.create_server(("127.0.0.1", port)) as server, socket.create_connection(here, timeout=5.0) as near:
            server.settimeout(5.0)
            far, _ = server.accept()
            with far:
                near.sendall(b"stop")
                assert far.recv(4) == b"stop"
