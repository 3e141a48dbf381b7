"""The one table of error codes: number, meaning, what a person does about it.

SIM and Carrier report the same numbers over the serial line; `Status.error_code` carries them to the command center.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import IntEnum

from common.plain_text import plain

SENTENCE_MAX = 1000  # characters: names of files may be long


class StartError(Exception):
    """A program cannot start as requested; the message is the one sentence that a person needs. Exit code 2."""


def sentence(error: Exception) -> str:
    """The sentence for a person, on one line: of a system's error the file and what is wrong with it."""
    text = str(error)
    if isinstance(error, OSError) and error.strerror is not None:
        file = error.filename2 or error.filename
        text = f"{os.fsdecode(file)}: {error.strerror}" if isinstance(file, (str, bytes)) else error.strerror
    return plain(text if text.endswith(".") else f"{text}.", SENTENCE_MAX)


class ErrorCode(IntEnum):
    OK = 0
    # 1xx: SIM
    SONAR_SILENT = 101
    IMU_SILENT = 102
    ENCODER_IMPLAUSIBLE = 103
    BATTERY_LOW = 104
    # 2xx: Carrier
    HEARTBEAT_LOST = 201
    BACKING_OFF = 202
    BUMPER = 203
    CLIFF = 204
    STOP_LATCHED = 205
    LOOP_LOCKUP = 206
    # 3xx: bridge
    SERIAL_LOST = 301
    PROTOCOL_MISMATCH = 302
    LINE_NOISE = 303
    NO_PERMIT = 304
    # 4xx: mmu
    NO_ODOMETRY = 401
    POSE_UNCERTAIN = 402
    # 5xx: planner
    NO_POSE = 501
    NO_RANGES = 502
    BLOCKED = 503
    EMERGENCY_ROUTINE = 504
    ZONES_LOST = 505
    # 6xx: poi
    NO_FRAMES = 601
    FRAMES_FROZEN = 602
    FRAMES_DARK = 603
    FRAMES_BRIGHT = 604
    FRAMES_RARE = 605
    NO_OCR = 606
    # 7xx: communication
    MODULE_MISSING = 701
    OPERATOR_STOP = 702
    RECORDER_AWAY = 703
    STOP_RECORD = 704
    # 8xx: recorder
    DISK_FULL = 801
    DISK_REFUSES = 802
    DATABASE_LOST = 803
    SECOND_RECORDER = 804
    # 9xx: anything
    INTERNAL = 901
    LATE = 902


@dataclass(frozen=True, slots=True)
class ErrorInfo:
    meaning: str
    action: str


ERRORS: dict[ErrorCode, ErrorInfo] = {
    ErrorCode.OK: ErrorInfo("no error", "nothing to do"),
    ErrorCode.SONAR_SILENT: ErrorInfo("a sonar gives no pulse at all", "check its plug and 5 V supply"),
    ErrorCode.IMU_SILENT: ErrorInfo("the MPU-6050 does not answer", "check the I2C wires, then power-cycle the Mega"),
    ErrorCode.ENCODER_IMPLAUSIBLE: ErrorInfo("a wheel turns but its encoder is silent", "check the encoder's plug"),
    ErrorCode.BATTERY_LOW: ErrorInfo("the battery is low", "charge the battery"),
    ErrorCode.HEARTBEAT_LOST: ErrorInfo("no heartbeat from the bridge", "check the USB cable and the BeagleBone"),
    ErrorCode.BACKING_OFF: ErrorInfo("an obstacle is too near; backing off", "clear the way"),
    ErrorCode.BUMPER: ErrorInfo("the bumper was hit", "clear the way"),
    ErrorCode.CLIFF: ErrorInfo("no floor in front", "turn the robot away from the stairs"),
    ErrorCode.STOP_LATCHED: ErrorInfo("a stop is latched", "release it in the command center when the way is clear"),
    ErrorCode.LOOP_LOCKUP: ErrorInfo("the firmware's loop stood still", "report it; the board has restarted"),
    ErrorCode.SERIAL_LOST: ErrorInfo("the serial line to the Mega is silent", "check the USB cable"),
    ErrorCode.PROTOCOL_MISMATCH: ErrorInfo("the Mega uses another protocol version", "flash the matching firmware"),
    ErrorCode.LINE_NOISE: ErrorInfo("many damaged lines on the serial line", "check the USB cable"),
    ErrorCode.NO_PERMIT: ErrorInfo("the Communication Module gives no permit to move", "see its own error"),
    ErrorCode.NO_ODOMETRY: ErrorInfo("no odometry arrives", "see the bridge and SIM"),
    ErrorCode.POSE_UNCERTAIN: ErrorInfo("the pose is too uncertain to drive by", "wait, or set the robot down anew"),
    ErrorCode.NO_POSE: ErrorInfo("no valid pose arrives", "see the mapping unit"),
    ErrorCode.NO_RANGES: ErrorInfo("no ranges arrive", "see the bridge and SIM"),
    ErrorCode.BLOCKED: ErrorInfo("the way is blocked", "clear the way; the robot tries again"),
    ErrorCode.EMERGENCY_ROUTINE: ErrorInfo("something is too near; stopped", "clear the way"),
    ErrorCode.ZONES_LOST: ErrorInfo(
        "the no-go lines and areas cannot be read",
        "remove all of them, then draw them anew",
    ),
    ErrorCode.NO_FRAMES: ErrorInfo("no camera frames arrive", "check the camera's ribbon cable"),
    ErrorCode.FRAMES_FROZEN: ErrorInfo("the camera repeats one picture", "pull its plug and put it in again"),
    ErrorCode.FRAMES_DARK: ErrorInfo("the camera's pictures are black", "uncover the lens, or light the hall"),
    ErrorCode.FRAMES_BRIGHT: ErrorInfo("the camera's pictures are overexposed", "shade the lens, or shorten exposure"),
    ErrorCode.FRAMES_RARE: ErrorInfo("camera frames come too seldom", "see what else runs on the Raspberry Pi"),
    ErrorCode.NO_OCR: ErrorInfo("the OCR engine is missing; doors stay unread", "install the extra 'vision'"),
    ErrorCode.MODULE_MISSING: ErrorInfo("an on-robot module is missing or not ready", "see which one in the log"),
    ErrorCode.OPERATOR_STOP: ErrorInfo("stopped by an operator", "release it on purpose when the way is clear"),
    ErrorCode.RECORDER_AWAY: ErrorInfo("the laptop's recorder is away; buffering", "check the Wi-Fi"),
    ErrorCode.STOP_RECORD: ErrorInfo("the robot's disk takes no stop record, so nothing moves", "free space on it"),
    ErrorCode.DISK_FULL: ErrorInfo("the laptop's disk takes nothing more", "free space; the recorder keeps trying"),
    ErrorCode.DISK_REFUSES: ErrorInfo("the run cannot be written", "see why in the log; the recorder keeps trying"),
    ErrorCode.DATABASE_LOST: ErrorInfo("the run goes on in a new database", "see in the log where the old one is"),
    ErrorCode.SECOND_RECORDER: ErrorInfo("another recorder receives the robot's messages", "end one of the two"),
    ErrorCode.INTERNAL: ErrorInfo("an unexpected error; the process restarts", "report the log file"),
    ErrorCode.LATE: ErrorInfo("the process cannot keep its rate", "see what else runs on this machine"),
}
