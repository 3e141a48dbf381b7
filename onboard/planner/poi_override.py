"""Table P2.0: the POI module may hold the robot, send it back a little, and let it go on; else the mission has its say.

A request while the Carrier turns is ignored, as the specification demands; a hold that nobody ends, ends by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.constants import REVERSE_MAX_M, SPEED_MEDIUM_M_S
from common.messages import PoiCommand, Speed

HOLD_MAX_S = 30.0
REVERSE_S = REVERSE_MAX_M / SPEED_MEDIUM_M_S  # over floor driven just now; then it stands


@dataclass(frozen=True, slots=True)
class Override:
    """The command in force and since when; CONTINUE = none."""

    command: PoiCommand = PoiCommand.CONTINUE
    since_s: float = 0.0


def after(state: Override, command: PoiCommand, now_s: float, turning: bool) -> Override:
    """The override once this request is heard. GOTO is no override: the mission drives there."""
    if turning or command is PoiCommand.GOTO:
        return state
    return state if command is state.command else Override(command, now_s)


def speed(state: Override, now_s: float) -> Speed | None:
    """What the override asks of the Carrier; None where the mission decides."""
    held_s = now_s - state.since_s
    if state.command is PoiCommand.CONTINUE or held_s > HOLD_MAX_S:
        return None
    return Speed.REVERSE if state.command is PoiCommand.REVERSE and held_s < REVERSE_S else Speed.STOP
