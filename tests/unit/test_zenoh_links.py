"""Links of Zenoh: whoever closes one is held up by nobody, and none between two routers stays deaf."""

from __future__ import annotations

import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace

import pytest
import zenoh

from common import zenoh_links
from common.clock import FreeClock
from common.config import Config, MeshSection
from common.messages.health import Status
from common.messages.topics import STATUS
from common.zenoh_bus import ZenohBus
from common.zenoh_channel import Channel, session_config
from common.zenoh_links import NeighbourWatch, _address, let_go_at_once
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


class Cable:
    """A TCP connection to a port, which can be cut; whoever connects again is connected again."""

    def __init__(self, port: int) -> None:
        self._port, self._ends = port, list[socket.socket]()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # the end
            while True:
                near, _ = self._server.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
                self._ends = [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    @staticmethod
    def _carry(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self) -> None:
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.cut()
        self._server.close()


@pytest.fixture
def port() -> int:
    return reserve_port()


@pytest.fixture
def cable(port: int) -> Iterator[Cable]:
    with closing(Cable(port)) as made:
        yield made


def within(deadline_s: float, condition: Callable[[], bool]) -> bool:
    end_s = time.monotonic() + deadline_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize("declares", [True, False], ids=["it declares its token", "nothing comes"])
def test_a_link_between_two_routers_is_opened_anew_while_nothing_comes_over_it(
    port: int, monkeypatch: pytest.MonkeyPatch, *, declares: bool
) -> None:
    monkeypatch.setattr(zenoh_links, "_DEAF_S", 0.3)
    endpoint = (f"tcp/127.0.0.1:{port}",)
    with (
        zenoh.open(session_config(Channel("router", endpoint))) as robot,
        zenoh.open(session_config(Channel("router", (), endpoint))) as laptop,
    ):
        token = robot.liveliness().declare_token("robot/comm/alive/1") if declares else None
        opened: list[zenoh.TransportEvent] = []
        listener = laptop.info.declare_transport_events_listener(zenoh.handlers.Callback(opened.append, indirect=False))
        watch = NeighbourWatch(laptop, "robot/comm/alive/**")
        assert within(2.0, lambda: len(opened) >= 2) is not declares
        assert within(5.0, lambda: len(laptop.info.links()) == 1)
        del token, listener, watch


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_routers_whose_link_flaps_quickly_receive_each_other_again(port: int, cable: Cable) -> None:
    laptop_router = f"tcp/127.0.0.1:{reserve_port()}"
    robot = Config(mesh=MeshSection(router=f"tcp/127.0.0.1:{port}", laptop_router=laptop_router))
    laptop = replace(robot, mesh=replace(robot.mesh, router=cable.endpoint))
    with (
        closing(ZenohBus("comm", robot, FreeClock(), "router")) as comm,
        closing(ZenohBus("recorder", laptop, FreeClock(), "router")) as recorder,
    ):
        published = 0

        def hear_each_other() -> bool:
            nonlocal published
            published += 1
            status = Status(0.0, "RUN", 0, 1, True, published)
            comm.publish(STATUS["comm"], status)
            recorder.publish(STATUS["recorder"], status)
            return all([comm.take(STATUS["recorder"]), recorder.take(STATUS["comm"])])

        assert within(10.0, hear_each_other)
        for pause_s in (0.11, 0.13, 0.15):
            for _ in range(3):
                cable.cut()
                time.sleep(pause_s)
            comm.take(STATUS["recorder"])
            recorder.take(STATUS["comm"])
            assert within(40.0, hear_each_other)
