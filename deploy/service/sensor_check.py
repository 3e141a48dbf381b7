"""`check-sensors`: live readings of the board, and what is wrong with them."""

from __future__ import annotations

import argparse

from common.constants import SONAR_NAMES
from common.errors import ErrorCode
from deploy.boards.board_session import BoardSession
from deploy.service.console import Output, Prompt
from onboard.bridge.protocol import OdoFlag

SELF_TEST_DEG = 30.0
_SWITCHES = (
    (OdoFlag.BUMPER, "bumper"),
    (OdoFlag.CLIFF_LEFT, "cliff left"),
    (OdoFlag.CLIFF_RIGHT, "cliff right"),
)


def check_sensors(session: BoardSession, arguments: argparse.Namespace, _: Prompt, output: Output) -> int:
    """Live readings, then one line per fault; exit code 1 when there is one."""
    ever: set[str] = set()  # sonars that answered at all
    for _half_second in range(round(arguments.seconds * 2)):
        session.run(0.5)
        if session.link.rng is not None:
            fresh = zip(SONAR_NAMES, session.link.rng.age_ms, strict=True)
            ever |= {name for name, age_ms in fresh if age_ms <= 250}
        output(_reading(session))
    faults = _faults(session, ever)
    if arguments.motors and not faults:
        faults = _motor_faults(session)
    for fault in faults:
        output(f"NOT OK  {fault}")
    if not faults:
        output("All of it answers as it should.")
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
    """A small turn to the left and back: both wheels, both encoders and the gyro must agree."""
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
