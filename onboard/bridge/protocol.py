"""The serial line's messages. Written by arduino/generate_protocol.py from protocol.toml; do not edit."""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import NamedTuple

VERSION = 2
HASH = 0x10A1
STOP_BYTE = b"\x18"
MAX_LINE = 120


class FieldSpec(NamedTuple):
    name: str
    length: int
    minimum: int
    maximum: int


class SimState(IntEnum):
    BOOT = 0
    RUNNING = 1
    FAULT = 2


class CarState(IntEnum):
    BOOT = 0
    DISARMED = 1
    READY = 2
    MOVING = 3
    BACKING_OFF = 4
    STOPPED = 5
    FAULT = 6


class OdoFlag(IntFlag):
    STANDING = 1
    BUMPER = 2
    CLIFF_LEFT = 4
    CLIFF_RIGHT = 8
    CALIBRATED = 16


class StopSourceFlag(IntFlag):
    LINE = 1
    BUTTON = 2
    PRESSED = 4


class ResetCause(IntEnum):
    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3


class AckResult(IntEnum):
    OK = 0
    REFUSED = 1


class Hello(NamedTuple):
    """SIM -> CM, at boot, then 1 Hz while not armed."""

    version: int
    hash: int  # of this file's messages
    reset_cause: int
    session: int  # another one after each restart


class Odo(NamedTuple):
    """SIM -> MMU, 10 Hz."""

    seq: int
    ticks_left: int  # cumulative quadrature edges
    ticks_right: int
    yaw_cdeg: int  # 0.01 deg
    by_walls_cdeg: int  # 0.01 deg, that much of yaw_cdeg is measured by walls, the rest by the gyro
    rate_cdps: int  # 0.01 deg/s
    x_mm: int  # mm
    y_mm: int  # mm
    speed_mm_s: int  # mm/s
    flags: int  # odo_flag


class Rng(NamedTuple):
    """SIM -> MMU, 10 Hz."""

    seq: int
    range_mm: tuple[int, ...]  # mm, from the transducer; 0 = no echo; left, front left, front, front right, right
    age_ms: tuple[int, ...]  # ms, since it was fired


class Dst(NamedTuple):
    """SIM -> PLN, 10 Hz."""

    left_mm: int  # mm, from the centre of the ring; 0 = no echo
    right_mm: int  # mm
    front_mm: int  # mm


class SimSta(NamedTuple):
    """SIM -> CM, 10 Hz."""

    state: int  # sim_state
    error: int  # common/errors.py
    free_ram: int  # bytes
    bad_lines: int  # damaged lines received
    pitch_cdeg: int  # 0.01 deg, nose up positive
    roll_cdeg: int  # 0.01 deg, left side up positive


class CarSta(NamedTuple):
    """CAR -> CM, 10 Hz and at once on change."""

    state: int  # car_state
    error: int  # common/errors.py
    boot: int  # of the commands that follow
    command_id: int  # in force, 0 = none
    completed_id: int  # the newest one whose heading was reached
    aborted_id: int  # the newest one given up
    speed_mm_s: int  # mm/s
    pwm_left: int
    pwm_right: int
    enabled: int
    stop_latched: int  # stop_source bits
    battery_mv: int  # mV
    backing_off: int


class Stp(NamedTuple):
    """CAR -> CM, 10 Hz and at once on change."""

    latched: int  # stop_source bits
    epoch: int  # of the newest stop that is known, 0 = none since the restart
    button_count: int  # how often the button was pressed since the restart


class Ack(NamedTuple):
    """CAR -> CM, on START, REL, STOP and DRV."""

    of: int  # number of the message type answered
    id: int  # command of a DRV, else 0
    result: int  # ack_result


class Start(NamedTuple):
    """CM -> CAR, after HELLO, when the robot may move."""

    hash: int  # another one than the board's is refused
    epoch: int  # an older one than the board's is refused


class Hb(NamedTuple):
    """CM -> CAR, 10 Hz while the robot may move."""

    seq: int
    epoch: int  # of the permit; an older one than the board's is no heartbeat


class Drv(NamedTuple):
    """PLN -> CAR, on a new command, then 10 Hz until it is in force."""

    boot: int  # of the planner, which counts its commands anew
    command_id: int
    speed: int  # REVERSE, STOP, MEDIUM, HIGH
    yaw_cdeg: int  # 0.01 deg


class Stop(NamedTuple):
    """CM -> CAR, like the stop byte, and until the board knows the epoch."""

    epoch: int


class Rel(NamedTuple):
    """CM -> CAR, releases the latched stop; moves nothing."""

    epoch: int  # an older one than the board's is refused


Message = Hello | Odo | Rng | Dst | SimSta | CarSta | Stp | Ack | Start | Hb | Drv | Stop | Rel

# (sender, receiver, type) and fields of each message
LAYOUT: dict[type[Message], tuple[str, str, str, tuple[FieldSpec, ...]]] = {
    Hello: (
        "SIM",
        "CM",
        "HELLO",
        (
            FieldSpec("version", 1, 0, 65535),
            FieldSpec("hash", 1, 0, 65535),
            FieldSpec("reset_cause", 1, 0, 255),
            FieldSpec("session", 1, 0, 65535),
        ),
    ),
    Odo: (
        "SIM",
        "MMU",
        "ODO",
        (
            FieldSpec("seq", 1, 0, 65535),
            FieldSpec("ticks_left", 1, -2147483648, 2147483647),
            FieldSpec("ticks_right", 1, -2147483648, 2147483647),
            FieldSpec("yaw_cdeg", 1, 0, 35999),
            FieldSpec("by_walls_cdeg", 1, -2147483648, 2147483647),
            FieldSpec("rate_cdps", 1, -60000, 60000),
            FieldSpec("x_mm", 1, -2147483648, 2147483647),
            FieldSpec("y_mm", 1, -2147483648, 2147483647),
            FieldSpec("speed_mm_s", 1, -2000, 2000),
            FieldSpec("flags", 1, 0, 255),
        ),
    ),
    Rng: (
        "SIM",
        "MMU",
        "RNG",
        (
            FieldSpec("seq", 1, 0, 65535),
            FieldSpec("range_mm", 5, 0, 6500),
            FieldSpec("age_ms", 5, 0, 65535),
        ),
    ),
    Dst: (
        "SIM",
        "PLN",
        "DST",
        (
            FieldSpec("left_mm", 1, 0, 6600),
            FieldSpec("right_mm", 1, 0, 6600),
            FieldSpec("front_mm", 1, 0, 6600),
        ),
    ),
    SimSta: (
        "SIM",
        "CM",
        "STA",
        (
            FieldSpec("state", 1, 0, 2),
            FieldSpec("error", 1, 0, 999),
            FieldSpec("free_ram", 1, 0, 65535),
            FieldSpec("bad_lines", 1, 0, 65535),
            FieldSpec("pitch_cdeg", 1, -9000, 9000),
            FieldSpec("roll_cdeg", 1, -18000, 18000),
        ),
    ),
    CarSta: (
        "CAR",
        "CM",
        "STA",
        (
            FieldSpec("state", 1, 0, 6),
            FieldSpec("error", 1, 0, 999),
            FieldSpec("boot", 1, 0, 65535),
            FieldSpec("command_id", 1, 0, 2147483647),
            FieldSpec("completed_id", 1, 0, 2147483647),
            FieldSpec("aborted_id", 1, 0, 2147483647),
            FieldSpec("speed_mm_s", 1, -2000, 2000),
            FieldSpec("pwm_left", 1, -255, 255),
            FieldSpec("pwm_right", 1, -255, 255),
            FieldSpec("enabled", 1, 0, 1),
            FieldSpec("stop_latched", 1, 0, 3),
            FieldSpec("battery_mv", 1, 0, 65535),
            FieldSpec("backing_off", 1, 0, 1),
        ),
    ),
    Stp: (
        "CAR",
        "CM",
        "STP",
        (
            FieldSpec("latched", 1, 0, 7),
            FieldSpec("epoch", 1, 0, 2147483647),
            FieldSpec("button_count", 1, 0, 65535),
        ),
    ),
    Ack: (
        "CAR",
        "CM",
        "ACK",
        (
            FieldSpec("of", 1, 0, 9),
            FieldSpec("id", 1, 0, 2147483647),
            FieldSpec("result", 1, 0, 1),
        ),
    ),
    Start: (
        "CM",
        "CAR",
        "START",
        (
            FieldSpec("hash", 1, 0, 65535),
            FieldSpec("epoch", 1, 0, 2147483647),
        ),
    ),
    Hb: (
        "CM",
        "CAR",
        "HB",
        (
            FieldSpec("seq", 1, 0, 65535),
            FieldSpec("epoch", 1, 0, 2147483647),
        ),
    ),
    Drv: (
        "PLN",
        "CAR",
        "DRV",
        (
            FieldSpec("boot", 1, 0, 65535),
            FieldSpec("command_id", 1, 1, 2147483647),
            FieldSpec("speed", 1, -1, 2),
            FieldSpec("yaw_cdeg", 1, 0, 35999),
        ),
    ),
    Stop: (
        "CM",
        "CAR",
        "STOP",
        (FieldSpec("epoch", 1, 0, 2147483647),),
    ),
    Rel: (
        "CM",
        "CAR",
        "REL",
        (FieldSpec("epoch", 1, 0, 2147483647),),
    ),
}

# `Ack.of` of the messages to the board
NUMBER: dict[type[Message], int] = {
    Start: 1,
    Hb: 2,
    Drv: 3,
    Stop: 4,
    Rel: 5,
}
