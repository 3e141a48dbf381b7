"""Verbs `check-sensors`, `drive` and `calibrate wheels|gyro`: a person and the board, nothing in between.

They speak the serial line themselves, so the bridge must not run meanwhile.
"""

from __future__ import annotations

import argparse
import select
import sys
import termios
import time
import tty
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.config import Config, load_config
from common.constants import SONAR_NAMES
from common.errors import ErrorCode, StartError
from common.messages import Speed
from deploy.board_session import BoardSession
from deploy.config_file import write_config
from offboard.evaluate.umbmark import WheelFit, fit_wheels
from onboard.bridge.protocol import OdoFlag
from onboard.bridge.serial_port import SerialLost, SerialPort

Ask = Callable[[str], str]
Tell = Callable[[str], None]

KEY_STEP_DEG = 15.0
SELF_TEST_DEG = 30.0
GYRO_TURNS = 3
_SWITCHES = (
    (OdoFlag.BUMPER, "bumper"),
    (OdoFlag.CLIFF_LEFT, "cliff left"),
    (OdoFlag.CLIFF_RIGHT, "cliff right"),
)


def add_verbs(verbs: Any) -> None:
    check = verbs.add_parser("check-sensors", help="live readings of the board, and what is wrong with them")
    check.add_argument("--seconds", type=float, default=10.0, help="how long (10)")
    check.add_argument("--motors", action="store_true", help="also turn a little: the wheels must be free")
    check.set_defaults(run=_with_board(check_sensors))
    drive = verbs.add_parser("drive", help="drive by the keys w W x a d, space stops, q ends")
    drive.set_defaults(run=_with_board(_drive_by_keyboard))
    _add_board_arguments(check, drive)


def add_calibrations(things: Any) -> None:
    wheels = things.add_parser("wheels", help="diameters and track, by squares in both directions (UMBmark)")
    wheels.add_argument("--side", type=float, default=2.0, help="of the square, metres (2)")
    wheels.add_argument("--rounds", type=int, default=2, help="squares in each direction (2)")
    wheels.set_defaults(run=_with_board(_calibrate_wheels))
    gyro = things.add_parser("gyro", help="the gyro's scale, by turns on the spot")
    gyro.set_defaults(run=_with_board(lambda session, _, ask, tell: calibrate_gyro(session, ask, tell)))
    _add_board_arguments(wheels, gyro)


def _add_board_arguments(*parsers: argparse.ArgumentParser) -> None:
    for parser in parsers:
        parser.add_argument("--config", type=Path, help="robot.toml")
        parser.add_argument("--port", help="serial port, instead of the one in robot.toml")


def _with_board(action: Callable[[BoardSession, argparse.Namespace, Ask, Tell], int]) -> Any:
    def run(arguments: argparse.Namespace) -> int:
        config = load_config(arguments.config)
        session = None
        try:
            port = SerialPort(arguments.port or config.bridge.serial_port, config.bridge.baud)
            session = BoardSession(port, time.monotonic, time.sleep)
            print("Waiting for the board to say HELLO ...")
            session.connect()
            return action(session, arguments, input, print)
        except SerialLost as error:
            session = None
            raise StartError(f"{error}.") from error
        except KeyboardInterrupt:
            return 130
        finally:
            if session is not None:
                session.link.stop()

    return run


# --- check-sensors


def check_sensors(session: BoardSession, arguments: argparse.Namespace, _: Ask, tell: Tell) -> int:
    """Live readings, then one line per fault; exit code 1 when there is one."""
    ever: set[str] = set()  # sonars that answered at all
    for _half_second in range(round(arguments.seconds * 2)):
        session.run(0.5)
        if session.link.rng is not None:
            fresh = zip(SONAR_NAMES, session.link.rng.age_ms, strict=True)
            ever |= {name for name, age_ms in fresh if age_ms <= 250}
        tell(_reading(session))
    faults = _faults(session, ever)
    if arguments.motors and not faults:
        faults = _motor_faults(session)
    for fault in faults:
        tell(f"NOT OK  {fault}")
    if not faults:
        tell("All of it answers as it should.")
    return 1 if faults else 0


def _reading(session: BoardSession) -> str:
    link = session.link
    if link.rng is None or link.odo is None or link.car is None or link.sim is None:
        return "silent"
    ranges = "  ".join(
        f"{name} {f'{mm / 10:.0f} cm' if mm else '-'}" for name, mm in zip(SONAR_NAMES, link.rng.range_mm, strict=True)
    )
    pressed = ", ".join(name for flag, name in _SWITCHES if link.odo.flags & flag) or "none"
    return (
        f"{ranges} | ticks {link.odo.ticks_left} {link.odo.ticks_right} | yaw {link.odo.yaw_cdeg / 100:.1f}, "
        f"pitch {link.sim.pitch_cdeg / 100:.1f}, roll {link.sim.roll_cdeg / 100:.1f} deg | "
        f"{link.car.battery_mv / 1000:.1f} V | switches {pressed}"
    )


def _faults(session: BoardSession, answered: set[str]) -> list[str]:
    link = session.link
    if link.sim is None or link.odo is None or link.car is None:
        return ["the board fell silent: check cable and battery"]
    faults = [f"sonar {name} does not answer: check its wires" for name in SONAR_NAMES if name not in answered]
    faults += [f"{name} is pressed, or its wire is open" for flag, name in _SWITCHES if link.odo.flags & flag]
    if link.sim.error not in (ErrorCode.OK, ErrorCode.SONAR_SILENT):
        faults.append(f"the board reports {ErrorCode(link.sim.error).name}")
    if link.car.stop_latched & 2:
        faults.append("the stop button is pressed, or its wire is open")
    if link.sim.bad_lines or link.bad_lines:
        faults.append(f"{link.sim.bad_lines} damaged lines at the board, {link.bad_lines} here: check the cable")
    return faults


def _motor_faults(session: BoardSession) -> list[str]:
    """A small turn to the left and back: both wheels, both encoders and the gyro must tell the same."""
    odo = session.link.odo
    assert odo is not None
    session.arm()
    before, yaw_deg = (odo.ticks_left, odo.ticks_right), odo.yaw_cdeg / 100.0
    session.turn_to(yaw_deg + SELF_TEST_DEG)
    session.run(0.3)
    assert session.link.odo is not None
    left, right = session.link.odo.ticks_left - before[0], session.link.odo.ticks_right - before[1]
    session.turn_to(yaw_deg)
    faults = []
    if left >= 0:
        faults.append(f"the left wheel counted {left} in a turn to the left: its encoder counts the wrong way")
    if right <= 0:
        faults.append(f"the right wheel counted {right} in a turn to the left: its encoder counts the wrong way")
    return faults


# --- drive


class HandDrive:
    """Keys -> commands: w on, W fast, x back, a and d turn by 15 degrees, space stops, q ends."""

    def __init__(self, session: BoardSession) -> None:
        self._session = session
        self._speed = Speed.STOP
        odo = session.link.odo
        self._yaw_deg = odo.yaw_cdeg / 100.0 if odo is not None else 0.0

    def key(self, key: str) -> bool:
        """Obeys; False when it is to end."""
        speeds = {"w": Speed.MEDIUM, "W": Speed.HIGH, "x": Speed.REVERSE}
        if key == "q":
            return False
        if key in speeds:
            self._speed = speeds[key]
        elif key in ("a", "d"):
            self._yaw_deg += KEY_STEP_DEG if key == "a" else -KEY_STEP_DEG
        elif key == " ":
            self._speed = Speed.STOP
            self._session.link.stop()
            return True
        else:
            return True
        self._session.link.allow_motion()
        self._session.link.drive(self._speed, self._yaw_deg)
        return True


def _drive_by_keyboard(session: BoardSession, _: argparse.Namespace, __: Ask, tell: Tell) -> int:
    tell("w on, W fast, x back (where it drove just now), a left, d right, space stops, q ends")
    hand = HandDrive(session)
    terminal = sys.stdin.fileno()
    if not sys.stdin.isatty():
        raise StartError("drive needs a terminal for its keys.")
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)
    try:
        while True:
            session.step()
            if select.select([sys.stdin], [], [], 0.0)[0] and not hand.key(sys.stdin.read(1)):
                return 0
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


# --- calibrate


def _calibrate_wheels(session: BoardSession, arguments: argparse.Namespace, ask: Ask, tell: Tell) -> int:
    fit = calibrate_wheels(session, arguments.side, arguments.rounds, ask, tell)
    tell(
        f"wheels {fit.diameter_m * 1000:.2f} mm (right over left {fit.ratio:.4f}), track {fit.track_m * 1000:.1f} mm; "
        f"end points unexplained by {fit.rms_m * 100:.1f} cm"
    )
    if arguments.config is None:
        tell("Not written: name the file with --config robot.toml.")
        return 0
    config = load_config(arguments.config)
    write_config(arguments.config, _calibrated(config, fit))
    tell(f"Written to {arguments.config}.")
    return 0


def _calibrated(config: Config, fit: WheelFit) -> Config:
    wheels = replace(config.wheels, diameter_m=round(fit.diameter_m, 6), track_m=round(fit.track_m, 5))
    return replace(config, wheels=wheels)


def calibrate_wheels(session: BoardSession, side_m: float, rounds: int, ask: Ask, tell: Tell) -> WheelFit:
    """A straight line, then squares both ways; asks where the robot really ended."""
    if side_m < 0.5 or rounds < 1:
        raise StartError("A square needs a side of at least 0.5 m, and one round in each direction.")
    tell(f"The robot needs {side_m + 1:.0f} m x {side_m + 1:.0f} m to its front and both sides.")
    runs: list[tuple[list[tuple[int, int]], tuple[float, float]]] = []
    for turn_deg, count, name in ((0.0, 1, "a line"), (90.0, rounds, "a square, left"), (-90.0, rounds, "right")):
        for _ in range(count):
            ask(f"Next {name}. Mark the floor under the robot's centre and its heading, then press Enter: ")
            counts = _drive_round(session, side_m, turn_deg)
            runs.append((counts, _place(ask)))
    return fit_wheels(runs)


def _drive_round(session: BoardSession, side_m: float, turn_deg: float) -> list[tuple[int, int]]:
    session.arm()
    assert session.link.odo is not None
    yaw_deg = session.link.odo.yaw_cdeg / 100.0
    session.record()
    for corner in range(4 if turn_deg else 1):
        heading_deg = yaw_deg + corner * turn_deg
        session.straight(side_m, heading_deg)
        session.turn_to(heading_deg + turn_deg)
    session.run(0.5)
    return list(session.counts)


def _place(ask: Ask) -> tuple[float, float]:
    while True:
        answer = ask("Where is its centre now, seen from the mark, in cm: forward,left (for example 3.5,-1): ")
        try:
            forward_cm, left_cm = (float(part) for part in answer.split(","))
        except ValueError:
            continue
        return forward_cm / 100.0, left_cm / 100.0


def calibrate_gyro(session: BoardSession, ask: Ask, tell: Tell) -> int:
    """Three turns on the spot, and by how much they missed: the gyro's scale for config.h."""
    ask("Mark the robot's heading on the floor, then press Enter: ")
    session.arm()
    assert session.link.odo is not None
    yaw_deg = session.link.odo.yaw_cdeg / 100.0
    for quarter in range(1, 4 * GYRO_TURNS + 1):
        session.turn_to(yaw_deg + 90.0 * quarter)
    session.run(0.5)
    assert session.link.odo is not None
    told_deg = 360.0 * GYRO_TURNS + (session.link.odo.yaw_cdeg / 100.0 - yaw_deg + 180.0) % 360.0 - 180.0
    while True:
        try:
            missed_deg = float(ask("By how many degrees has it turned too far to the left (too short: negative): "))
            break
        except ValueError:
            continue
    scale = told_deg / (360.0 * GYRO_TURNS + missed_deg)
    tell(f"The gyro shows {scale:.4f} of the true turn.")
    tell(f"Set kGyroLsbPer10Dps = {round(655 * scale)} in arduino/indoor_mapping/src/config.h, and flash again.")
    return 0
