"""comm, mmu and planner in one process, as on the BeagleBone: whatever fails, the wheels stop and it is named."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from common.messages.mission import Operation, OperatorCommand
from common.messages.topics import LOG, OPERATION, STATUS
from tests.system.conftest import Mesh, until

pytestmark = pytest.mark.timeout(60)
SHARED = "comm+mmu+planner"
PROGRAM = Path(__file__).with_name("sharing.py")
STANDS_WITHIN_S = 0.5
Start = Callable[[str, str], Mesh]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    with closing(Mesh(tmp_path)) as mesh:

        def started(victim: str, fault: str) -> Mesh:
            mesh.start(SHARED, str(PROGRAM), victim, fault)
            mesh.start("bridge")
            until(lambda: mesh.granted, 20.0, "a permit")
            mesh.bus.take(LOG["mmu"])
            mesh.bus.take(LOG["planner"])

            def moving() -> bool:
                mesh.bus.publish(OPERATION, OperatorCommand(0.0, Operation.START))
                return not mesh.standing

            until(moving, what="motion")
            return mesh

        yield started


def hit(mesh: Mesh) -> float:
    """The victim receives what it cannot bear; returns when."""
    mesh.bus.publish(OPERATION, OperatorCommand(0.0, Operation.GOTO))
    return time.monotonic()


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("victim", ["mmu", "planner"])
def test_a_node_that_never_comes_back_stops_the_wheels_and_comm_names_it(start: Start, victim: str) -> None:
    mesh = start(victim, "stuck")
    hit_s = hit(mesh)
    assert mesh.revoked_after(hit_s) <= STANDS_WITHIN_S
    until(lambda: mesh.standing, 2.0, "standing")
    assert time.monotonic() - hit_s <= STANDS_WITHIN_S + 0.1  # and the way to this process
    until(lambda: victim in mesh.permits[-1][1].reason, 2.0, "the name of the victim")
    # The rest of the process lives
    comm = mesh.bus.latest(STATUS["comm"])
    until(lambda: mesh.bus.latest(STATUS["comm"]) != comm, 2.0, "a new status of comm")


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("victim", ["mmu", "planner"])
def test_a_node_that_fails_stops_the_wheels_and_says_so_before_its_process_ends(start: Start, victim: str) -> None:
    mesh = start(victim, "fails")
    hit_s = hit(mesh)
    until(lambda: mesh.standing, 2.0, "standing")
    assert time.monotonic() - hit_s <= STANDS_WITHIN_S + 0.1
    assert mesh.processes[SHARED].wait(10.0) == 1
    lines = [line.text for line in mesh.bus.take(LOG[victim])]
    assert any("quite unexpected" in line for line in lines), lines


@pytest.mark.requirement("CM_MR_02")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_robot_stands_when_the_whole_process_dies_or_freezes(start: Start, number: signal.Signals) -> None:
    mesh = start("planner", "fails")
    hit_s = mesh.signal(SHARED, number)
    until(lambda: mesh.standing, 2.0, "standing")
    assert time.monotonic() - hit_s <= STANDS_WITHIN_S
    # Who looks knows what is missing: all that was in it
    until(lambda: not {"comm", "mmu", "planner"} & mesh.bus.alive_tokens(), 2.0, "their tokens to go")
    if number == signal.SIGSTOP:
        mesh.signal(SHARED, signal.SIGCONT)
        until(lambda: mesh.granted, 5.0, "the permit after the thaw")
