"""Bridge and comm react as fast as their loops of 100 and 50 Hz did, though they are stepped when something is due."""

from __future__ import annotations

from dataclasses import replace

import pytest

from common.bus import LocalMesh
from common.config import CommSection
from common.constants import PERMIT_TIMEOUT_S
from common.messages.health import Status
from common.messages.motion import CarrierReport, CarrierState
from common.messages.stop import Permit, StopRequest
from common.messages.topics import CARRIER, PERMIT, STATUS, STOP
from onboard.bridge.bridge import Bridge
from onboard.bridge.line_protocol import LineDecoder, encode
from onboard.bridge.protocol import HASH, STOP_BYTE, VERSION, CarSta, Hb, Hello, Stp
from onboard.comm.comm import Comm
from tests.unit.due_steps import DueSteps

MARGIN_S = 0.0015


class QuietPort:
    """A board that is ready, standing and silent but for what the test lets it send."""

    def __init__(self) -> None:
        self.incoming, self.sent = b"", b""

    def read(self) -> bytes:
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> None:
        self.sent += data

    def fileno(self) -> int | None:
        return None


class PermittedBridge(DueSteps):
    """Permits and reports come ten times a second."""

    def __init__(self) -> None:
        mesh = LocalMesh()
        self.port = QuietPort()
        super().__init__(mesh, mesh.endpoint("bridge"), Bridge(lambda: self.port))
        self.others = mesh.endpoint("test")
        self.permitted_s = 0.0
        self.port.incoming = encode(Hello(VERSION, HASH, 0, 1), 1)
        self.run(1.0, self.permit)
        self.port.sent = b""

    def reports(self, now_s: float) -> None:
        if round(now_s * 1000) % 100 == 0:
            time_ms = round(now_s * 1000)
            ready = CarSta(2, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 12000, 0)
            self.port.incoming += encode(ready, time_ms) + encode(Stp(0, 1, 0), time_ms)

    def permit(self, now_s: float) -> None:
        self.reports(now_s)
        if round(now_s * 1000) % 100 == 50:
            self.permitted_s = now_s
            self.others.publish(PERMIT, Permit(now_s, True, "", stop_epoch=1, life=7))

    def stopped(self) -> bool:
        return STOP_BYTE in self.port.sent


@pytest.mark.requirement("CAR_MR_05")
def test_a_permit_that_stops_coming_stops_the_board_within_10_ms_of_its_timeout() -> None:
    bridge = PermittedBridge()
    bridge.run(0.123, bridge.permit)
    assert not bridge.stopped()
    bridge.seconds_until(bridge.stopped, bridge.reports)
    age_s = bridge.mesh.now_s - bridge.permitted_s
    assert PERMIT_TIMEOUT_S < age_s <= PERMIT_TIMEOUT_S + 0.01 + MARGIN_S


@pytest.mark.requirement("CAR_MR_05")
@pytest.mark.parametrize("phase_ms", range(0, 100, 7))
def test_a_stop_reaches_the_board_within_10_ms_whenever_it_comes(phase_ms: int) -> None:
    bridge = PermittedBridge()
    bridge.run(0.1 + phase_ms / 1000, bridge.permit)
    bridge.others.publish(STOP, StopRequest(bridge.mesh.now_s, "operator", True, stop_id=5))
    assert bridge.seconds_until(bridge.stopped, bridge.permit) <= 0.01 + MARGIN_S


def test_heartbeats_keep_their_rate_with_few_steps() -> None:
    bridge = PermittedBridge()
    steps = bridge.steps
    bridge.run(3.0, bridge.permit)
    heartbeats = [r for r in LineDecoder().feed(bridge.port.sent) if isinstance(r.message, Hb)]
    assert 29 <= len(heartbeats) <= 31
    assert bridge.steps - steps <= 3 * 25


def knows(permit: Permit, now_s: float) -> CarrierReport:
    """The bridge has received the permit."""
    ready = CarrierReport(now_s, CarrierState.READY, 0, 0, 0, 0.0, 0, 0, True, False, 12.0)
    return replace(ready, bridge_epoch=permit.stop_epoch, board_epoch=permit.stop_epoch, comm_life=permit.life)


class WatchedModules(DueSteps):
    """comm, and two modules that are only statuses."""

    def __init__(self) -> None:
        mesh = LocalMesh()
        super().__init__(mesh, mesh.endpoint("comm"), Comm(CommSection(required=("bridge", "mmu"))))
        self.others = mesh.endpoint("test")
        self.silent: set[str] = set()
        self.others.take(PERMIT)
        self.run(3.0, self.report)
        assert self.granted()

    def report(self, now_s: float) -> None:
        for module, phase_ms in (("bridge", 15), ("mmu", 40)):
            if round(now_s * 1000) % 100 == phase_ms and module not in self.silent:
                self.others.publish(STATUS[module], Status(now_s, "RUN", 0, 0, True, round(now_s * 1000)), news=False)
                newest = self.others.latest(PERMIT)
                if module == "bridge" and newest is not None:
                    self.others.publish(CARRIER, knows(newest, now_s), news=False)

    def granted(self) -> bool:
        permit = self.others.latest(PERMIT)
        return permit is not None and permit.granted


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("module", ["bridge", "mmu"])
@pytest.mark.parametrize("phase_ms", [0, 16, 41, 77])
def test_a_module_that_falls_silent_costs_the_permit_within_250_ms(module: str, phase_ms: int) -> None:
    modules = WatchedModules()
    modules.run(phase_ms / 1000, modules.report)
    modules.silent.add(module)
    assert modules.seconds_until(lambda: not modules.granted(), modules.report) <= 0.25


def test_permits_keep_their_rate_with_ten_steps_a_second() -> None:
    modules = WatchedModules()
    modules.others.take(PERMIT)
    steps = modules.steps
    modules.run(3.0, modules.report)
    assert 29 <= len(modules.others.take(PERMIT)) <= 31
    assert modules.steps - steps <= 3 * 15


def test_a_stop_is_in_the_permit_at_once() -> None:
    modules = WatchedModules()
    modules.others.publish(STOP, StopRequest(modules.mesh.now_s, "operator", True, stop_id=5))
    assert modules.seconds_until(lambda: not modules.granted(), modules.report) <= 0.01 + MARGIN_S
