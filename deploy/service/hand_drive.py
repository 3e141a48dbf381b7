"""`drive`: the robot driven by the keys of a terminal."""

from __future__ import annotations

import argparse
import select
import sys
import termios
import tty

from common.errors import StartError
from common.messages.motion import Speed
from deploy.boards.board_session import BoardSession
from deploy.service.console import Output, Prompt

KEY_STEP_DEG = 15.0


class HandDrive:
    """Keys -> commands: w on, W fast, x back, a and d turn by 15 degrees, space stops, q ends."""

    def __init__(self, session: BoardSession) -> None:
        self._session = session
        self._speed = Speed.STOP
        odo = session.link.odo
        self._yaw_deg = odo.yaw_cdeg / 100.0 if odo is not None else 0.0

    def key(self, key: str) -> bool:
        """Executes the command of a key; False for the key that ends the drive."""
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


def drive_by_keyboard(session: BoardSession, _: argparse.Namespace, __: Prompt, output: Output) -> int:
    output("w on, W fast, x back (where it drove just now), a left, d right, space stops, q ends")
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
