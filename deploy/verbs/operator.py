"""Verbs of the operator: `release`, `start`, `pause`, `resume`, `home`, `goto ROOM_OR_X,Y`, `pose X,Y,DEG`.

The rules of the stop and of the commands are those of the Command Center.
"""

from __future__ import annotations

import argparse
import sys
import time
from math import inf, isfinite, radians
from pathlib import Path
from typing import Any

from common.clock import FreeClock
from common.config_file import load_config
from common.errors import StartError
from common.messages.mission import Operation
from common.messages.topics import CARRIER, PERMIT
from common.mission_state import hindrance
from common.zenoh_bus import ZenohBus
from offboard.operate import operations, software_stop
from offboard.operate.operations import Answer, Order
from offboard.operate.operator_client import operate, request_release, wait_until
from offboard.operate.order_sender import answer_to
from offboard.operate.software_stop import Demand, StopControl

LINK_TIMEOUT_S = 2.0
POSE_SD_M, POSE_SD_DEG = 0.5, 15.0  # as RViz sends them


def add_verbs(verbs: Any) -> None:
    for name, run, text in (
        ("release", _release, "release the software stop; nothing moves before a resume"),
        ("start", _operation, "begin the mission"),
        ("pause", _operation, "stand until resume"),
        ("resume", _operation, "go on"),
        ("home", _operation, "drive home"),
        ("goto", _operation, "drive to a door or to a place on the map"),
        ("pose", _pose, "tell a robot that was carried where on the map it stands"),
    ):
        parser = verbs.add_parser(name, help=text)
        parser.add_argument("--config", type=Path, help="robot.toml of the mesh")
        if name == "goto":
            parser.add_argument(
                "place", metavar="ROOM_OR_X,Y", help="door number, or metres on the map, for example -3,1.5"
            )
            parser.add_argument("--run-dir", type=Path, help="run folder whose doors are meant; found by --config")
        if name == "pose":
            parser.add_argument("pose", metavar="X,Y,HEADING", help="metres on the map, and degrees, left positive")
            parser.add_argument("--doubt-m", type=float, default=POSE_SD_M, help="standard deviation of the place")
            parser.add_argument(
                "--doubt-deg", type=float, default=POSE_SD_DEG, help="standard deviation of the heading"
            )
        parser.set_defaults(run=run)


def join(config: Path | None) -> ZenohBus:
    """The mesh, as a client with the rights of the Command Center; raises StartError."""
    return ZenohBus("command_center", load_config(config), FreeClock(), "client")


def _release(arguments: argparse.Namespace) -> int:
    bus = join(arguments.config)
    try:
        # The permit names what is latched, the Carrier reports whether the button is pressed
        wait_until(lambda: bus.latest(PERMIT) is not None and bus.latest(CARRIER) is not None, LINK_TIMEOUT_S)
        if bus.latest(PERMIT) is None:
            print("No message from the robot arrived, so nothing was released.", file=sys.stderr)
            return 1
        now_s = time.monotonic()
        report = software_stop.robot_report(bus, now_s)
        if report.permit.stop_epoch and not report.permit.stop_sources:
            print("No stop is latched; `resume` lets a robot that waits go on.")
            return 0
        refusal = software_stop.release_hindrance(StopControl(), report, now_s)
        if refusal:
            print(refusal, file=sys.stderr)
            return 1
        control = request_release(bus)
        if control.demand is Demand.RELEASE or control.release_failed:
            print("The robot did not confirm the release.", file=sys.stderr)
            return 1
        print("Released; `resume` lets the robot go on.")
        return 0
    finally:
        bus.close()


def _operation(arguments: argparse.Namespace) -> int:
    operation = Operation(arguments.verb)
    x_m, y_m = _place(arguments) if operation is Operation.GOTO else (0.0, 0.0)
    return give(arguments.config, Order(operation, x_m, y_m))


def _pose(arguments: argparse.Namespace) -> int:
    try:
        numbers = [float(part) for part in arguments.pose.split(",")]
        x_m, y_m, heading_deg = numbers
        sds = arguments.doubt_m, radians(arguments.doubt_deg)
        if not all(map(isfinite, numbers)) or not all(0.0 <= sd < inf for sd in sds):
            raise ValueError
    except ValueError:
        raise StartError(
            f"{arguments.pose} is no pose: X,Y in metres and HEADING in degrees, for example 3,-1.5,90"
        ) from None
    order = Order(Operation.POSE, x_m, y_m, heading_rad=radians(heading_deg), sd_m=sds[0], sd_heading_rad=sds[1])
    return give(arguments.config, order)


def give(config: Path | None, order: Order) -> int:
    """Sends it until it is answered, and prints the answer; the exit code."""
    bus = join(config)
    try:
        wait_until(lambda: bus.latest(PERMIT) is not None, LINK_TIMEOUT_S)
        permit = bus.latest(PERMIT)
        # What the planner is doing it knows best itself
        refusal = hindrance(order.operation, None, permit)
        if refusal:
            print(refusal, file=sys.stderr)
            return 1
        answer = operate(bus, order)
        name = order.operation.value
        sentence = operations.result_sentence(name, answer, bus.latest(PERMIT), answer_to(bus, name))
        print(sentence, file=sys.stdout if answer is Answer.TAKEN else sys.stderr)
        return 0 if answer is Answer.TAKEN else 1
    finally:
        bus.close()


def _place(arguments: argparse.Namespace) -> tuple[float, float]:
    """Found before it connects to the mesh; raises StartError."""
    # Here, because a stop needs none of it
    from offboard.command_center.places import UnknownPlace, coordinates, find_place, findings_of_run, run_folder_of

    try:
        place = coordinates(arguments.place)
        if place is not None:
            return place
        folder = arguments.run_dir or run_folder_of(arguments.config)
        if folder is None:
            raise UnknownPlace(
                f"Whose door {arguments.place} is not known: give the run's folder with --run-dir, or its "
                "process/robot.toml with --config; or write X,Y in metres."
            )
        return find_place(arguments.place, findings_of_run(folder).values())
    except UnknownPlace as error:
        raise StartError(str(error)) from error
