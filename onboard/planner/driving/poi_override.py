"""Table P2.0: the POI module may hold the robot, send it back a little, and let it go on; else the mission decides.

A request while the Carrier turns is ignored, as the specification demands; a hold ends by itself after a
while. The firmware limits how far back the robot drives: only over floor driven just now.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.messages.motion import Speed
from common.messages.points_of_interest import PoiCommand

HOLD_MAX_S = 30.0


@dataclass(frozen=True, slots=True)
class Override:
    """The command in force and since when; CONTINUE = none."""

    command: PoiCommand = PoiCommand.CONTINUE
    since_s: float = 0.0


def after(state: Override, command: PoiCommand, now_s: float, turning: bool) -> Override:
    """The override once this request is received. GOTO is no override: the mission drives there."""
    if turning or command is PoiCommand.GOTO:
        return state
    return state if command is state.command else Override(command, now_s)


def speed(state: Override, now_s: float) -> Speed | None:
    """The speed that the override commands; None where the mission decides."""
    if state.command is PoiCommand.CONTINUE or now_s - state.since_s > HOLD_MAX_S:
        return None
    return Speed.REVERSE if state.command is PoiCommand.REVERSE else Speed.STOP
