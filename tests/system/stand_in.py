"""A process that stands in for a module: `python stand_in.py NAME --config robot.toml`.

Every one is ready at once, and its status names whom it knows to be there. "mmu" has a map; "planner" drives from a
start or a resume on; "bridge" has a board that knows every stop at once, and moves while its gate lets it and it is
asked to drive; "simulator" leads the shared clock.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from common.bus import Bus
from common.config import Config
from common.messages.mapping import MapUpdate
from common.messages.mission import Operation, PlannerView
from common.messages.motion import DriveCommand, Odometry, Speed
from common.messages.topics import CARRIER, DRIVE, MAP, ODOMETRY, OPERATION, PERMIT, PLAN, STATUS, STOP
from common.process import argument_parser, run
from common.status import StatusReporter
from common.zenoh_bus import ZenohBus
from onboard.bridge.motion_gate import MotionGate
from onboard.bridge.protocol import CarSta, CarState, Stp
from onboard.bridge.translation import carrier_report

MAP_POINTS = 12_000  # 108 kB


class StandIn:
    period_s = 0.02
    wakes_on = ()

    def __init__(self, name: str) -> None:
        self.name = name
        self._status = StatusReporter(name) if name in STATUS else None

    def step(self, bus: Bus, now_s: float) -> None:
        if self._status is not None:
            assert isinstance(bus, ZenohBus)
            self._status.report(bus, now_s, state="RUN", ready=True, detail=" ".join(sorted(bus.alive_tokens())))

    def close(self) -> None:
        pass


class StandInMmu(StandIn):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._has_map = False

    def step(self, bus: Bus, now_s: float) -> None:
        super().step(bus, now_s)
        if not self._has_map:
            points_m = np.zeros((MAP_POINTS, 2), np.float32)
            bus.publish(MAP, MapUpdate(now_s, 1, 0, points_m, np.zeros(MAP_POINTS, np.uint8)))
        self._has_map = True


class StandInPlanner(StandIn):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._drives = False

    def step(self, bus: Bus, now_s: float) -> None:
        super().step(bus, now_s)
        for command in bus.take(OPERATION):
            self._drives = command.operation in (Operation.START, Operation.RESUME)
            path_m = np.zeros((0, 2), np.float32)
            bus.publish(PLAN, PlannerView(now_s, "", "", path_m, 0, 0.0, command_id=command.command_id))
        bus.publish(DRIVE, DriveCommand(now_s, 1, Speed.MEDIUM if self._drives else Speed.STOP, 0.0))


class StandInBridge(StandIn):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._gate = MotionGate()

    def step(self, bus: Bus, now_s: float) -> None:
        super().step(bus, now_s)
        for request in bus.take(STOP):
            self._gate.request(request)
        drive = bus.latest(DRIVE)
        permitted = self._gate.may_move(bus.latest(PERMIT), bus.age_s(PERMIT))
        moves = permitted and drive is not None and drive.speed is not Speed.STOP
        speed_m_s = 0.16 if moves else 0.0
        bus.publish(ODOMETRY, Odometry(now_s, 0, 0, 0.0, 0.0, 0.0, 0.0, speed_m_s, not moves, False, False, 1))
        board = CarSta(CarState.READY, 0, 0, 0, 0, 0, round(1000 * speed_m_s), 0, 0, int(permitted), 0, 12000, 0)
        stop = Stp(0, self._gate.epoch, 0)
        self._gate.board(1, stop)
        bus.publish(CARRIER, carrier_report(board, stop, now_s, self._gate))


def make(_: Config, arguments: argparse.Namespace) -> StandIn:
    kinds = {"mmu": StandInMmu, "planner": StandInPlanner, "bridge": StandInBridge}
    return kinds.get(arguments.name, StandIn)(arguments.name)


if __name__ == "__main__":
    parser = argument_parser("stand_in")
    parser.add_argument("name")
    sys.exit(run(sys.argv[1], make, parser=parser, leads_clock=sys.argv[1] == "simulator"))
