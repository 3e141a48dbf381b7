"""`--clock shared` between real processes: it is fast, it waits for who is late, and nobody can stop it."""

from __future__ import annotations

import itertools
import signal
import time

import pytest

from common.clock import SILENT_S, WINDOW_S
from common.messages.health import ClockTick
from common.messages.topics import CLOCK, ODOMETRY
from tests.system.conftest import Mesh, until

pytestmark = pytest.mark.timeout(60)
SPEED = 5.0
SHARED = ("--clock", "shared", "--speed", str(SPEED))


@pytest.fixture
def ticks(mesh: Mesh) -> list[tuple[float, ClockTick]]:
    """A mesh under the shared clock; every tick with its monotonic time of arrival."""
    heard: list[tuple[float, ClockTick]] = []
    for name in ("comm", "simulator", "bridge", "mmu", "planner"):
        mesh.start(name, extra=SHARED)

    def receive(tick: ClockTick) -> None:
        # One that holds the clock may have missed the last tick: it is said again
        if not heard or tick.t_s > heard[-1][1].t_s:
            heard.append((time.monotonic(), tick))

    mesh.bus.subscribe(CLOCK, receive)
    until(lambda: mesh.granted, 20.0, "a permit")
    return heard


def test_the_clock_runs_at_its_speed_and_the_permit_stands(mesh: Mesh, ticks: list[tuple[float, ClockTick]]) -> None:
    first = len(ticks)
    since_s = time.monotonic()
    until(lambda: ticks[-1][0] - ticks[first - 1][0] > 3.0)
    (wall_0, tick_0), (wall_1, tick_1) = ticks[first - 1], ticks[-1]
    # At most its speed; the lower bound leaves room for a busy machine
    assert 0.4 * SPEED < (tick_1.t_s - tick_0.t_s) / (wall_1 - wall_0) < 1.05 * SPEED
    assert all(permit.granted for t, permit in mesh.permits if t > since_s)
    odometry = mesh.bus.latest(ODOMETRY)
    assert odometry is not None
    assert abs(odometry.t_s - ticks[-1][1].t_s) <= WINDOW_S + 0.1


def test_a_frozen_process_holds_the_clock_for_a_second_at_most(
    mesh: Mesh, ticks: list[tuple[float, ClockTick]]
) -> None:
    frozen_s = mesh.signal("planner", signal.SIGSTOP)
    until(lambda: ticks[-1][0] > frozen_s + 0.9 * SILENT_S, what="the clock after the freeze")
    held_s = max(b[0] - a[0] for a, b in itertools.pairwise(ticks) if b[0] > frozen_s)
    assert held_s < SILENT_S + 0.5
    mesh.revoked_after(frozen_s)
    mesh.signal("planner", signal.SIGCONT)
    until(lambda: mesh.granted, what="the permit after the thaw")


def test_a_dead_process_does_not_stop_the_clock(mesh: Mesh, ticks: list[tuple[float, ClockTick]]) -> None:
    killed_s = mesh.signal("planner", signal.SIGKILL)
    until(lambda: ticks[-1][0] > killed_s + 0.9 * SILENT_S, what="the clock after the death")
    mesh.revoked_after(killed_s)
