"""Verbs of the operator: `estop` and `release`, `start`, `pause`, `resume`, `home`, `goto ROOM_OR_X,Y`.

The rules of the stop and of the commands are the Command Center's; here is one demand, repeated until it is confirmed.
"""

from __future__ import annotations

import argparse
import secrets
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.clock import FreeClock
from common.config import load_config
from common.errors import StartError
from common.messages import CARRIER, OPERATION, PERMIT, PLAN, POI, STOP, Operation, OperatorCommand
from common.zenoh_bus import ZenohBus
from offboard.command_center import operations, software_stop
from offboard.command_center.operations import Answer, PendingOperation
from offboard.command_center.places import UnknownPlace, coordinates, find_place, findings_of_run, run_folder_of
from offboard.command_center.snapshot import Finding
from offboard.command_center.software_stop import Demand, StopControl

CONFIRM_TIMEOUT_S = 5.0
LINK_TIMEOUT_S = 2.0
_POLL_S = 0.01


def add_verbs(verbs: Any) -> None:
    for name, run, text in (
        ("estop", _estop, "latch the software stop; the red button on the robot is the emergency stop"),
        ("release", _release, "release the software stop; nothing moves before a resume"),
        ("start", _operation, "begin the mission"),
        ("pause", _operation, "stand until resume"),
        ("resume", _operation, "go on"),
        ("home", _operation, "drive home"),
        ("goto", _operation, "drive to a door or to a place on the map"),
    ):
        parser = verbs.add_parser(name, help=text)
        parser.add_argument("--config", type=Path, help="robot.toml of the mesh")
        if name == "goto":
            parser.add_argument(
                "place", metavar="ROOM_OR_X,Y", help="door number, or metres; a leading minus needs -- before"
            )
            parser.add_argument("--run-dir", type=Path, help="run folder whose doors are meant; found by --config")
        parser.set_defaults(run=run)


def _join(arguments: argparse.Namespace) -> ZenohBus:
    return ZenohBus("command_center", load_config(arguments.config), FreeClock(), "client")


def _wait(condition: Callable[[], bool], timeout_s: float) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(_POLL_S)
    return True


def sent_until_confirmed(bus: ZenohBus, control: StopControl) -> StopControl:
    """Sends what is demanded until the robot confirms or CONFIRM_TIMEOUT_S are over; returns what is left."""
    next_s = 0.0

    def over() -> bool:
        nonlocal control, next_s
        now_s = time.monotonic()
        control = software_stop.heard(control, software_stop.robot_report(bus, now_s), now_s)
        request = software_stop.request(control, now_s)
        if request is not None and now_s >= next_s:
            next_s = now_s + software_stop.REPEAT_S
            bus.publish(STOP, request)
        return control.demand is Demand.NONE

    _wait(over, CONFIRM_TIMEOUT_S)
    return control


def press_stop(bus: ZenohBus) -> tuple[StopControl, int]:
    """One press, sent until it is confirmed: what is left, and the number of the press."""
    pressed = software_stop.pressed(StopControl(), time.monotonic(), software_stop.new_stop_id(secrets.randbits))
    return sent_until_confirmed(bus, pressed), pressed.stop_id


def ask_release(bus: ZenohBus) -> StopControl:
    """The release of the stop that the robot reports now, sent until it is confirmed; what is left."""
    now_s = time.monotonic()
    report = software_stop.robot_report(bus, now_s)
    return sent_until_confirmed(bus, software_stop.release_asked(StopControl(), report, now_s))


def operate(bus: ZenohBus, operation: Operation, x_m: float = 0.0, y_m: float = 0.0) -> Answer:
    """One command of the operator, sent until it is taken."""
    permit = bus.latest(PERMIT)
    epoch = permit.stop_epoch if permit is not None else 0
    command_id = operations.new_command_id(secrets.randbits)
    command = OperatorCommand(time.monotonic(), operation, x_m, y_m, command_id=command_id, epoch=epoch)
    return _repeated_until_taken(bus, PendingOperation(command, time.monotonic()))


def _estop(arguments: argparse.Namespace) -> int:
    bus = _join(arguments)
    try:
        control, stop_id = press_stop(bus)
        if control.latency_s is not None:
            latency_ms = 1000 * control.latency_s
            print(f"Stopped: the stop is latched and the wheels stand still, confirmed in {latency_ms:.0f} ms.")
            return 0
        permit = bus.latest(PERMIT)
        latched = permit is not None and stop_id in permit.stop_ids
        known = "The stop is latched, but nobody says that the wheels stand still" if latched else "Not confirmed"
        print(f"{known}: use the red button on the robot.", file=sys.stderr)
        return 1
    finally:
        bus.close()


def _release(arguments: argparse.Namespace) -> int:
    bus = _join(arguments)
    try:
        # The permit says what is latched, the Carrier whether the button is pressed
        _wait(lambda: bus.latest(PERMIT) is not None and bus.latest(CARRIER) is not None, LINK_TIMEOUT_S)
        if bus.latest(PERMIT) is None:
            print("The robot is not heard, so nothing was released.", file=sys.stderr)
            return 1
        now_s = time.monotonic()
        report = software_stop.robot_report(bus, now_s)
        if report.stop_epoch and not report.stop_sources:
            print("No stop is latched; `resume` lets a robot that waits go on.")
            return 0
        hindrance = software_stop.release_hindrance(StopControl(), report, now_s)
        if hindrance:
            print(hindrance, file=sys.stderr)
            return 1
        control = ask_release(bus)
        if control.demand is Demand.RELEASE or control.release_failed:
            print("The robot did not confirm the release.", file=sys.stderr)
            return 1
        print("Released; `resume` lets the robot go on.")
        return 0
    finally:
        bus.close()


def _operation(arguments: argparse.Namespace) -> int:
    if arguments.verb == "goto":
        _check_place(arguments.place)
    bus = _join(arguments)
    try:
        operation = Operation(arguments.verb)
        x_m, y_m = _place(bus, arguments) if operation is Operation.GOTO else (0.0, 0.0)
        _wait(lambda: bus.latest(PERMIT) is not None, LINK_TIMEOUT_S)
        permit = bus.latest(PERMIT)
        hindrance = operations.hindrance(operation, permit)
        if hindrance:
            print(hindrance, file=sys.stderr)
            return 1
        answer = operate(bus, operation, x_m, y_m)
        sentence = operations.result_sentence(arguments.verb, answer, bus.latest(PERMIT), bus.latest(PLAN))
        print(sentence, file=sys.stdout if answer is Answer.TAKEN else sys.stderr)
        return 0 if answer is Answer.TAKEN else 1
    finally:
        bus.close()


def _repeated_until_taken(bus: ZenohBus, pending: PendingOperation) -> Answer:
    """Sends the command until the planner has taken it, or nobody has answered for long."""
    answer, next_s = Answer.WAITING, 0.0
    while answer is Answer.WAITING:
        now_s = time.monotonic()
        if now_s >= next_s:
            next_s = now_s + operations.REPEAT_S
            bus.publish(OPERATION, pending.command)
        time.sleep(_POLL_S)
        answer = pending.answer(bus.latest(PLAN), bus.latest(PERMIT), time.monotonic())
    return answer


def _check_place(text: str) -> None:
    """What is wrong with the words themselves needs no mesh to be said."""
    try:
        coordinates(text)
    except UnknownPlace as error:
        raise StartError(str(error)) from error


def _place(bus: ZenohBus, arguments: argparse.Namespace) -> tuple[float, float]:
    folder = arguments.run_dir or run_folder_of(arguments.config)
    known = findings_of_run(folder) if folder is not None else {}
    known |= {poi.poi_id: Finding(poi.number, poi.x_m, poi.y_m) for poi in bus.take(POI)}
    try:
        return find_place(arguments.place, known.values())
    except UnknownPlace as error:
        raise StartError(str(error)) from error
