"""What a process reports to systemd, at a socket that stands in for it."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from common import service_notify
from common.service_notify import ADDRESS, WATCHDOG_PERIOD_S, ServiceNotifier

NODES = ("comm", "mmu", "planner")


class Systemd:
    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(address)

    def received(self) -> list[str]:
        """Since the last call."""
        messages = []
        with suppress(BlockingIOError):
            while True:
                messages.append(self.socket.recv(1000).decode())
        return messages


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Systemd]:
    made = Systemd(str(tmp_path / "notify"))
    yield made
    made.socket.close()


@pytest.fixture
def notifier(tmp_path: Path, systemd: Systemd) -> ServiceNotifier:
    return ServiceNotifier(NODES, str(tmp_path / "notify"))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Its only element is the time."""
    now_s = [100.0]
    monkeypatch.setattr(service_notify.time, "monotonic", lambda: now_s[0])
    return now_s


def step_all(notifier: ServiceNotifier, *nodes: str) -> None:
    for node in nodes or NODES:
        notifier.stepped(node)


def test_ready_alive_and_stopping_arrive(notifier: ServiceNotifier, systemd: Systemd) -> None:
    notifier.ready()
    step_all(notifier)
    notifier.stopping()
    assert systemd.received() == ["READY=1", "WATCHDOG=1", "STOPPING=1"]


def test_the_watchdog_is_fed_at_most_once_a_second(
    notifier: ServiceNotifier, systemd: Systemd, clock: list[float]
) -> None:
    for _ in range(100):
        step_all(notifier)
        clock[0] += WATCHDOG_PERIOD_S / 20
    assert systemd.received() == ["WATCHDOG=1"] * 5


def test_one_loop_that_is_stuck_lets_the_watchdog_bite(
    notifier: ServiceNotifier, systemd: Systemd, clock: list[float]
) -> None:
    step_all(notifier)
    systemd.received()
    for _ in range(100):
        clock[0] += WATCHDOG_PERIOD_S
        step_all(notifier, "comm", "planner")
    assert systemd.received() == []
    step_all(notifier, "mmu")
    assert systemd.received() == ["WATCHDOG=1"]


def test_an_abstract_address_is_one() -> None:
    name = f"indoor-mapping-test-{os.getpid()}"
    systemd = Systemd("\0" + name)
    ServiceNotifier(NODES, f"@{name}").ready()
    assert systemd.received() == ["READY=1"]
    systemd.socket.close()


def test_a_systemd_that_is_gone_holds_nobody_up(notifier: ServiceNotifier, systemd: Systemd, tmp_path: Path) -> None:
    (tmp_path / "notify").unlink()
    notifier.ready()


def test_where_no_systemd_waits_nothing_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ADDRESS, raising=False)
    assert service_notify.from_environment(NODES) is None


def test_what_a_process_starts_does_not_report_in_its_place(
    tmp_path: Path, systemd: Systemd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(ADDRESS, str(tmp_path / "notify"))
    notifier = service_notify.from_environment(NODES)
    assert notifier is not None
    notifier.ready()
    assert systemd.received() == ["READY=1"]
    assert ADDRESS not in os.environ
