"""comm as a real process among stand-ins, on the free-running clock: absence means stop, and soon.

One mesh serves all tests, one after the other: each leaves it whole.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from common.messages.mission import Operation, OperatorCommand
from common.messages.topics import OPERATION
from tests.system.conftest import Mesh, until

pytestmark = pytest.mark.timeout(60)
REVOKED_WITHIN_S = 0.25


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mesh]:
    with closing(Mesh(tmp_path_factory.mktemp("mesh"))) as made:
        made.start_all()
        yield made


@pytest.fixture(autouse=True)
def whole(mesh: Mesh) -> None:
    begun_s = time.monotonic()
    until(lambda: mesh.granted and mesh.permits[-1][0] > begun_s, 20.0, "a new permit")


def drive(mesh: Mesh, operation: Operation = Operation.START) -> None:
    def moving() -> bool:
        mesh.bus.publish(OPERATION, OperatorCommand(0.0, operation))
        return not mesh.standing

    until(moving, what="motion")


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("victim", ["mmu", "planner", "bridge"])
def test_permit_ends_within_250_ms_when_a_module_is_killed_and_comes_back_with_it(mesh: Mesh, victim: str) -> None:
    killed_s = mesh.signal(victim, signal.SIGKILL)
    assert mesh.revoked_after(killed_s) <= REVOKED_WITHIN_S
    mesh.processes[victim].wait()
    mesh.start(victim)
    until(lambda: mesh.granted, what="the permit after the restart")


@pytest.mark.requirement("CM_MR_02")
def test_permit_ends_within_250_ms_when_a_module_freezes(mesh: Mesh) -> None:
    for _ in range(2):
        frozen_s = mesh.signal("mmu", signal.SIGSTOP)
        assert mesh.revoked_after(frozen_s) <= REVOKED_WITHIN_S
        mesh.signal("mmu", signal.SIGCONT)
        until(lambda: mesh.granted, what="the permit after the thaw")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_robot_stands_when_comm_dies_or_freezes_and_its_neighbours_stay_joined(
    mesh: Mesh, number: signal.Signals
) -> None:
    drive(mesh)
    hit_s = mesh.signal("comm", number)
    until(lambda: mesh.standing, 2.0, "standing")
    # The permit's age limit, the stand-in's period and the way to this process
    assert time.monotonic() - hit_s <= 0.35
    until(lambda: "comm" not in mesh.bus.alive_tokens(), 2.0)
    assert {"bridge", "mmu", "planner"} <= mesh.bus.alive_tokens()
    assert mesh.standing
    if number == signal.SIGSTOP:
        mesh.signal("comm", signal.SIGCONT)
    else:
        mesh.processes["comm"].wait()
        mesh.start("comm")


def test_stop_outlives_a_restart_of_comm(mesh: Mesh) -> None:
    assert mesh.command("estop").returncode == 0
    mesh.signal("comm", signal.SIGKILL)
    mesh.processes["comm"].wait()
    mesh.permits.clear()
    mesh.start("comm")
    until(
        lambda: mesh.permits and mesh.permits[-1][1].stop_sources == ("operator",), what="the latch after the restart"
    )
    assert not mesh.granted
    until(lambda: mesh.permits[-1][1].stop_epoch, what="the bridge's answer")
    assert mesh.command("release").returncode == 0
    assert mesh.command("resume").returncode == 0
