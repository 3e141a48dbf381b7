"""A planner that marches by numbers: `python marching_planner.py SPEED BOOT --config robot.toml`.

With a permit it says twenty times a second to drive straight on, COMMANDS commands in all, and then repeats the last
one, whose speed is SPEED, for as long as it lives.
"""

from __future__ import annotations

import argparse
import sys

from common.bus import Bus
from common.config import Config
from common.messages.motion import DriveCommand, Speed
from common.messages.topics import DRIVE, PERMIT
from common.process import argument_parser, run
from common.status import StatusReporter

COMMANDS = 26


class MarchingPlanner:
    name = "planner"
    period_s = 0.05
    wakes_on = ()

    def __init__(self, last: Speed, boot: int) -> None:
        self._last, self._boot = last, boot
        self._count = 0
        self._status = StatusReporter(self.name)

    def step(self, bus: Bus, now_s: float) -> None:
        self._status.report(bus, now_s, state="MARCH", ready=True)
        permit = bus.latest(PERMIT)
        if permit is None or not permit.granted:
            return
        self._count = min(self._count + 1, COMMANDS)
        speed = self._last if self._count == COMMANDS else Speed.MEDIUM
        bus.publish(DRIVE, DriveCommand(now_s, self._count, speed, 0.0, boot=self._boot))

    def close(self) -> None:
        pass


def make(_: Config, arguments: argparse.Namespace) -> MarchingPlanner:
    return MarchingPlanner(Speed[arguments.last], arguments.boot)


if __name__ == "__main__":
    parser = argument_parser("marching_planner")
    parser.add_argument("last", metavar="SPEED")
    parser.add_argument("boot", type=int)
    sys.exit(run("planner", make, parser=parser))
