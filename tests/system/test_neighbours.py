"""Modules that lose each other find each other again, with comm and without it, and nobody has to restart one."""

from __future__ import annotations

import random
import signal
import time

import pytest

from common.messages.topics import STATUS
from tests.system.conftest import Mesh, until

pytestmark = pytest.mark.timeout(60)
MODULES = ("bridge", "mmu", "planner")
# Around the lease some links of a frozen process are given up and others are not
FREEZES_S = (0.30, 0.42)


def knows(mesh: Mesh, module: str) -> set[str]:
    """Of whom a module says that they are there; nobody while it is not heard itself."""
    status = mesh.bus.latest(STATUS[module])
    fresh = status is not None and mesh.bus.age_s(STATUS[module]) < 0.5
    return set(status.detail.split()) if fresh and status is not None else set()


def all_joined(mesh: Mesh) -> bool:
    return all(knows(mesh, module) >= set(MODULES) - {module} for module in MODULES)


@pytest.mark.requirement("CM_MR_02")
def test_who_was_frozen_while_comm_is_gone_is_joined_again_by_every_neighbour(mesh: Mesh) -> None:
    mesh.start_all()
    until(lambda: all_joined(mesh), what="all neighbours")
    mesh.processes["comm"].kill()
    for victim in MODULES:
        others = [module for module in MODULES if module != victim]
        mesh.signal(victim, signal.SIGSTOP)
        until(lambda others=others, victim=victim: all(victim not in knows(mesh, other) for other in others))
        mesh.signal(victim, signal.SIGCONT)
        until(lambda: all_joined(mesh), 3.0, f"all neighbours after the thaw of {victim}")


@pytest.mark.slow
@pytest.mark.timeout(240)
@pytest.mark.requirement("CM_MR_02")
def test_no_freeze_as_long_as_the_lease_parts_two_neighbours_for_good(mesh: Mesh) -> None:
    mesh.start_all()
    draw = random.Random(1)
    for number in range(100):
        victim, span_s = draw.choice(MODULES), draw.uniform(*FREEZES_S)
        thaw_s = mesh.signal(victim, signal.SIGSTOP) + span_s
        until(lambda thaw_s=thaw_s: time.monotonic() >= thaw_s)
        mesh.signal(victim, signal.SIGCONT)
        what = f"all neighbours after freeze {number}, of {victim} for {span_s:.3f} s"
        # A link is given up some time after the thaw
        until(lambda thaw_s=thaw_s: time.monotonic() > thaw_s + 0.5 and all_joined(mesh), 5.0, what)
        until(lambda: mesh.granted, 5.0, f"the permit after freeze {number}")
