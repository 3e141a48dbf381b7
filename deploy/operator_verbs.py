"""Verbs of the operator: `estop` and `release`, `start`, `pause`, `resume`, `home`, `goto X,Y`.

The stop is a state: sent again and again until the robot says that it is latched and that its wheels stand still.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.clock import FreeClock
from common.config import load_config
from common.errors import StartError
from common.messages import ODOMETRY, OPERATION, PERMIT, STOP, Operation, OperatorCommand, StopRequest
from common.zenoh_bus import ZenohBus

SOURCE = "operator"
REPEAT_S = 0.05
CONFIRM_TIMEOUT_S = 5.0
# Not acknowledged by the planner: repeated so often that one lost link change cannot swallow it
_OPERATION_REPEATS = 5


def add_verbs(verbs: Any) -> None:
    for name, run, text in (
        ("estop", _estop, "latch the software stop; the red button on the robot is the emergency stop"),
        ("release", _release, "release the software stop; nothing moves before a resume"),
        ("start", _operation, "begin the mission"),
        ("pause", _operation, "stand until resume"),
        ("resume", _operation, "go on"),
        ("home", _operation, "drive home"),
        ("goto", _operation, "drive to a place on the map"),
    ):
        parser = verbs.add_parser(name, help=text)
        parser.add_argument("--config", type=Path, help="robot.toml of the mesh")
        if name == "goto":
            parser.add_argument(
                "place", metavar="X,Y", help="metres in the map's frame; a leading minus needs -- before it"
            )
        parser.set_defaults(run=run)


def _join(arguments: argparse.Namespace) -> ZenohBus:
    return ZenohBus("command_center", load_config(arguments.config), FreeClock(), "client")


def _repeat(send: Callable[[], None], confirmed: Callable[[], bool]) -> bool:
    deadline_s = time.monotonic() + CONFIRM_TIMEOUT_S
    while time.monotonic() < deadline_s:
        send()
        time.sleep(REPEAT_S)
        if confirmed():
            return True
    return False


def _estop(arguments: argparse.Namespace) -> int:
    bus = _join(arguments)
    try:

        def latched() -> bool:
            permit = bus.latest(PERMIT)
            return permit is not None and SOURCE in permit.stop_sources

        def standing() -> bool:
            odometry = bus.latest(ODOMETRY)
            return latched() and odometry is not None and odometry.standing

        if _repeat(lambda: bus.publish(STOP, StopRequest(time.monotonic(), SOURCE, latched=True)), standing):
            print("Stopped: the stop is latched and the wheels stand still.")
            return 0
        known = "The stop is latched, but nobody says that the wheels stand still" if latched() else "Not confirmed"
        print(f"{known}: use the red button on the robot.", file=sys.stderr)
        return 1
    finally:
        bus.close()


def _release(arguments: argparse.Namespace) -> int:
    bus = _join(arguments)
    try:

        def free() -> bool:
            permit = bus.latest(PERMIT)
            return permit is not None and SOURCE not in permit.stop_sources

        if not _repeat(lambda: bus.publish(STOP, StopRequest(time.monotonic(), SOURCE, latched=False)), free):
            print("The robot did not confirm the release.", file=sys.stderr)
            return 1
        permit = bus.latest(PERMIT)
        others = ", ".join(permit.stop_sources) if permit is not None else ""
        print(f"Released; still stopped by {others}." if others else "Released; `resume` lets the robot go on.")
        return 0
    finally:
        bus.close()


def _operation(arguments: argparse.Namespace) -> int:
    x_m, y_m = _place(arguments.place) if arguments.verb == "goto" else (0.0, 0.0)
    command = OperatorCommand(time.monotonic(), Operation(arguments.verb), x_m, y_m)
    bus = _join(arguments)
    try:
        for _ in range(_OPERATION_REPEATS):
            bus.publish(OPERATION, command)
            time.sleep(REPEAT_S)
        return 0
    finally:
        bus.close()


def _place(text: str) -> tuple[float, float]:
    try:
        x_m, y_m = (float(part) for part in text.split(","))
    except ValueError as error:
        raise StartError(f"A place is written X,Y in metres, for example 3.5,-1; not {text}.") from error
    return x_m, y_m
