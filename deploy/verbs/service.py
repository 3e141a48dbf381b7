"""Verbs `check-sensors`, `drive` and `calibrate wheels|gyro|doors|camera`: a person and the robot, without the mesh.

The tools at the board use its serial line themselves, so the bridge must not run meanwhile.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.config_file import load_config
from common.errors import StartError
from deploy.boards.board_session import BoardSession
from deploy.service.body_calibration import calibrate_gyro, calibrate_wheels
from deploy.service.console import Output, Prompt
from deploy.service.hand_drive import drive_by_keyboard
from deploy.service.sensor_check import check_sensors
from onboard.bridge.serial_port import SerialLost, SerialPort

_CORNERS = range(3, 31)  # of a side of the chessboard: what OpenCV finds


def add_verbs(verbs: Any) -> None:
    check = verbs.add_parser("check-sensors", help="live readings of the board, and what is wrong with them")
    check.add_argument("--seconds", type=float, default=10.0, help="how long (10)")
    check.add_argument("--motors", action="store_true", help="also turn a little: the wheels must be free")
    check.set_defaults(run=_at_board(check_sensors))
    drive = verbs.add_parser("drive", help="drive by the keys w W x a d, space stops, q ends")
    drive.set_defaults(run=_at_board(drive_by_keyboard))
    calibrate = verbs.add_parser("calibrate", help="measure this very robot and write it into robot.toml")
    things = calibrate.add_subparsers(dest="what", metavar="WHAT", required=True)
    wheels = things.add_parser("wheels", help="diameters and track, by squares in both directions (UMBmark)")
    wheels.add_argument("--side", type=float, default=2.0, help="of the square, metres (2)")
    wheels.add_argument("--rounds", type=int, default=2, help="squares in each direction (2)")
    wheels.set_defaults(run=_at_board(calibrate_wheels))
    gyro = things.add_parser("gyro", help="the gyro's scale, by turns on the spot")
    gyro.set_defaults(run=_at_board(calibrate_gyro))
    for parser in (check, drive, wheels, gyro):
        parser.add_argument("--config", type=Path, help="robot.toml")
        parser.add_argument("--port", help="serial port, instead of the one in robot.toml")
    _add_photo_calibrations(things)


def _add_photo_calibrations(things: Any) -> None:
    doors = things.add_parser("doors", help="the colour of doors, from a photo of one and of the wall beside it")
    doors.add_argument("photo", metavar="PHOTO", type=Path, help="a door in its middle, wall left and right of it")
    doors.add_argument("--wall", metavar="PHOTO", type=Path, help="of the wall, where the other shows none")
    doors.set_defaults(run=_calibrate_doors)
    camera = things.add_parser("camera", help="the field of view, from photos of a chessboard")
    camera.add_argument("photos", metavar="PHOTO", type=Path, nargs="+")
    camera.add_argument("--columns", type=int, default=9, choices=_CORNERS, metavar="N", help="inner corners along (9)")
    camera.add_argument("--rows", type=int, default=6, choices=_CORNERS, metavar="N", help="inner corners across (6)")
    camera.set_defaults(run=_calibrate_camera)
    for parser in (doors, camera):
        parser.add_argument("--config", type=Path, default=Path("robot.toml"), help="the file to write (robot.toml)")


def _calibrate_doors(arguments: argparse.Namespace) -> int:
    from deploy.service.photo_calibration import calibrate_doors  # here, because it loads OpenCV

    return calibrate_doors(arguments)


def _calibrate_camera(arguments: argparse.Namespace) -> int:
    from deploy.service.photo_calibration import calibrate_camera  # here, because it loads OpenCV

    return calibrate_camera(arguments)


def _at_board(
    tool: Callable[[BoardSession, argparse.Namespace, Prompt, Output], int],
) -> Callable[[argparse.Namespace], int]:
    def run(arguments: argparse.Namespace) -> int:
        config = load_config(arguments.config)
        session = None
        try:
            port = SerialPort(arguments.port or config.bridge.serial_port, config.bridge.baud)
            session = BoardSession(port, time.monotonic, time.sleep)
            print("Waiting for HELLO of the board ...")
            session.connect()
            return tool(session, arguments, input, print)
        except SerialLost as error:
            session = None
            raise StartError(f"{error}.") from error
        except KeyboardInterrupt:
            return 130
        finally:
            if session is not None:
                session.link.stop()

    return run
