"""Steps a node exactly when its own agenda demands, on a local mesh, as lockstep and processes do."""

from __future__ import annotations

from collections.abc import Callable

from common.bus import LocalBus, LocalMesh
from common.node import Agenda, Node

TICK_S = 0.001


class DueSteps:
    """`each` is called every millisecond, before the node is looked at."""

    def __init__(self, mesh: LocalMesh, bus: LocalBus, node: Node) -> None:
        self.mesh, self.bus, self.node = mesh, bus, node
        self.agenda = Agenda(node, mesh.now_s)
        self.steps = 0
        bus.wake_on(node.wakes_on)

    def run(self, duration_s: float, each: Callable[[float], object] = lambda now_s: None) -> None:
        for _ in range(round(duration_s / TICK_S)):
            now_s = self.mesh.now_s = round(self.mesh.now_s + TICK_S, 6)
            each(now_s)
            if now_s >= self.agenda.due_s or (self.bus.woken and now_s >= self.agenda.earliest_s):
                self.bus.woken = False
                self.steps += 1
                self.agenda.stepped(now_s, self.node.step(self.bus, now_s))

    def seconds_until(self, holds: Callable[[], bool], each: Callable[[float], object] = lambda now_s: None) -> float:
        begin_s = self.mesh.now_s
        while not holds():
            assert self.mesh.now_s < begin_s + 2.0, "not within 2 s"
            self.run(TICK_S, each)
        return self.mesh.now_s - begin_s
