"""`calibrate wheels` and `calibrate gyro`: drives of this very robot, and the end points that a person measured."""

from __future__ import annotations

import argparse
from dataclasses import replace

from common.config import Config
from common.config_file import load_config
from common.errors import StartError
from deploy.boards.board_session import BoardSession
from deploy.service.config_file import write_config
from deploy.service.console import Output, Prompt
from offboard.evaluate.umbmark import WheelFit, fit_wheels

GYRO_TURNS = 3


def calibrate_wheels(session: BoardSession, arguments: argparse.Namespace, prompt: Prompt, output: Output) -> int:
    fit = measure_wheels(session, arguments.side, arguments.rounds, prompt, output)
    output(
        f"wheels {fit.diameter_m * 1000:.2f} mm (right over left {fit.ratio:.4f}), track {fit.track_m * 1000:.1f} mm; "
        f"end points unexplained by {fit.rms_m * 100:.1f} cm"
    )
    if arguments.config is None:
        output("Not written: name the file with --config robot.toml.")
        return 0
    config = load_config(arguments.config)
    write_config(arguments.config, calibrated(config, fit))
    output(f"Written to {arguments.config}.")
    return 0


def calibrated(config: Config, fit: WheelFit) -> Config:
    wheels = replace(config.wheels, diameter_m=round(fit.diameter_m, 6), track_m=round(fit.track_m, 5))
    return replace(config, wheels=wheels)


def measure_wheels(session: BoardSession, side_m: float, rounds: int, prompt: Prompt, output: Output) -> WheelFit:
    """A straight line, then squares both ways; prompts for the measured end point of each."""
    if side_m < 0.5 or rounds < 1:
        raise StartError("A square needs a side of at least 0.5 m, and one round in each direction.")
    output(f"The robot needs {side_m + 1:.0f} m x {side_m + 1:.0f} m to its front and both sides.")
    runs: list[tuple[list[tuple[int, int]], tuple[float, float]]] = []
    for turn_deg, count, name in ((0.0, 1, "a line"), (90.0, rounds, "a square, left"), (-90.0, rounds, "right")):
        for _ in range(count):
            prompt(f"Next {name}. Mark the floor under the robot's centre and its heading, then press Enter: ")
            counts = _drive_round(session, side_m, turn_deg)
            runs.append((counts, _place(prompt)))
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


def _place(prompt: Prompt) -> tuple[float, float]:
    while True:
        answer = prompt("Where is its centre now, seen from the mark, in cm: forward,left (for example 3.5,-1): ")
        try:
            forward_cm, left_cm = (float(part) for part in answer.split(","))
        except ValueError:
            continue
        return forward_cm / 100.0, left_cm / 100.0


def calibrate_gyro(session: BoardSession, _: argparse.Namespace, prompt: Prompt, output: Output) -> int:
    """Three turns on the spot, and by how much they missed: the gyro's scale for config.h."""
    prompt("Mark the robot's heading on the floor, then press Enter: ")
    session.arm()
    assert session.link.odo is not None
    yaw_deg = session.link.odo.yaw_cdeg / 100.0
    for quarter in range(1, 4 * GYRO_TURNS + 1):
        session.turn_to(yaw_deg + 90.0 * quarter)
    session.run(0.5)
    assert session.link.odo is not None
    reported_deg = 360.0 * GYRO_TURNS + (session.link.odo.yaw_cdeg / 100.0 - yaw_deg + 180.0) % 360.0 - 180.0
    while True:
        try:
            missed_deg = float(prompt("By how many degrees has it turned too far to the left (too short: negative): "))
            break
        except ValueError:
            continue
    scale = reported_deg / (360.0 * GYRO_TURNS + missed_deg)
    output(f"The gyro shows {scale:.4f} of the true turn.")
    output(f"Set kGyroLsbPer10Dps = {round(655 * scale)} in arduino/indoor_mapping/src/config.h, and flash again.")
    return 0
