"""Verb `door`: what a person says of a door that was found: its number, its room's name."""

from __future__ import annotations

import argparse
import secrets
import sys
import time
from pathlib import Path
from typing import Any

from common.errors import StartError
from common.fields import WORD_MAX
from common.messages.topics import DOOR_NOTES, PERMIT
from deploy.verbs.operator import LINK_TIMEOUT_S, join
from offboard.command_center.places import UnknownPlace, find_door, findings_of_run, run_folder_of
from offboard.operate.door_sender import SENTENCES, DoorSender
from offboard.operate.operations import Answer
from offboard.operate.operator_client import wait_until

_POLL_S = 0.01


def add_verbs(verbs: Any) -> None:
    parser = verbs.add_parser("door", help="confirm or correct a door's number, name its room")
    parser.add_argument("door", metavar="NUMBER_OR_NAME", help="as it is shown now, or #ID")
    parser.add_argument("--number", metavar="NUMBER", help="its number; the one that was read confirms it")
    parser.add_argument("--name", metavar="NAME", help='of its room; "" takes it back')
    parser.add_argument("--forget", action="store_true", help="take back all that was said of it")
    parser.add_argument("--config", type=Path, help="robot.toml of the mesh")
    parser.add_argument("--run-dir", type=Path, help="run folder whose doors are meant; found by --config")
    parser.set_defaults(run=_note)


def _note(arguments: argparse.Namespace) -> int:
    """Judged before it connects to the mesh; raises StartError."""
    if not arguments.forget and arguments.number is None and arguments.name is None:
        raise StartError("Say something of the door: --number, --name or --forget.")
    if any(len(text or "") > WORD_MAX for text in (arguments.number, arguments.name)):
        raise StartError(f"A number or name has at most {WORD_MAX} letters.")
    folder = arguments.run_dir or run_folder_of(arguments.config)
    if folder is None:
        raise StartError("Whose door is meant is not known: give --run-dir, or --config of the run.")
    try:
        poi_id, door = find_door(arguments.door, findings_of_run(folder))
    except UnknownPlace as error:
        raise StartError(str(error)) from error
    # What was said before stays, unless it is said anew
    number = door.number if door.judged else ""
    number, name = ("", "") if arguments.forget else (number, door.room_name)
    number = number if arguments.number is None else arguments.number
    name = name if arguments.name is None else arguments.name
    return _sent(arguments.config, poi_id, (door.x_m, door.y_m), number, name)


def _sent(config: Path | None, poi_id: int, place_m: tuple[float, float], number: str, name: str) -> int:
    bus = join(config)
    try:
        bus.latest(DOOR_NOTES)
        wait_until(lambda: bus.latest(PERMIT) is not None, LINK_TIMEOUT_S)
        doors = DoorSender(secrets.randbits)
        doors.give(time.monotonic(), poi_id, place_m, number, name)
        while (answer := doors.step(bus, time.monotonic())) is Answer.WAITING:
            time.sleep(_POLL_S)
        assert answer is not None
        print(SENTENCES[answer], file=sys.stdout if answer is Answer.TAKEN else sys.stderr)
        return 0 if answer is Answer.TAKEN else 1
    finally:
        bus.close()
