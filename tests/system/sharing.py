"""Modules in one process with the real comm, of which one gets stuck or fails when it receives a `goto`.

python sharing.py comm+mmu+planner --victim planner --fault stuck ...
"""

from __future__ import annotations

import sys

from common.bus import Bus
from common.messages.mission import Operation
from common.messages.topics import OPERATION
from common.process import run_together
from onboard.comm.comm import make_comm
from tests.system.stand_in import StandInMmu, StandInPlanner


def _fail(fault: str) -> None:
    if fault == "fails":
        raise RuntimeError("quite unexpected")
    while True:  # Python code that never comes back; the interpreter still switches to other threads
        pass


def _victim(kind: type, fault: str) -> type:
    class Victim(kind):  # type: ignore[misc]
        def step(self, bus: Bus, now_s: float) -> None:
            newest = bus.latest(OPERATION)
            if newest is not None and newest.operation is Operation.GOTO:
                _fail(fault)
            super().step(bus, now_s)

    return Victim


if __name__ == "__main__":
    victim, fault = sys.argv[1:3]
    kinds = {"mmu": StandInMmu, "planner": StandInPlanner}
    kinds[victim] = _victim(kinds[victim], fault)
    factories = {name: lambda _config, _arguments, name=name: kinds[name](name) for name in kinds}
    sys.exit(run_together("comm+mmu+planner", {"comm": make_comm} | factories, sys.argv[3:]))
