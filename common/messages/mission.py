"""The mission: a person's orders, the planner's view of it, its outcome."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from common.fields import (
    AllCorners,
    Blacklisted,
    CommandId,
    Count,
    Epoch,
    Metres,
    PathPoints,
    Radians,
    Seconds,
    Spread,
    SquareMetres,
    Text,
    Word,
    ZoneCorners,
    ZoneKinds,
    ZoneNumbers,
)


class Outcome(Enum):
    """How the newest order to the Planner ended (onboard/planner/mission/table.py)."""

    NONE = "none"  # not ended, or none was given
    FINISHED = "finished"  # everything that can be reached is explored, and the robot is home
    HOME = "home"  # sent home before that, and there
    ARRIVED = "arrived"  # at the place of a goto
    GAVE_UP = "gave up"  # no path led there for too long
    NEEDS_HELP = "needs help"  # no way home for too long: somebody has to come
    LOW_BATTERY = "low battery"  # home before all was explored, because the battery would not have lasted
    STOPPED = "stopped"  # a latched stop holds it; it goes on after release and resume

    @property
    def ends_mission(self) -> bool:
        """Is the run over, as far as the robot is concerned?"""
        return self in (Outcome.FINISHED, Outcome.HOME, Outcome.LOW_BATTERY, Outcome.GAVE_UP, Outcome.NEEDS_HELP)

    @property
    def exit_code(self) -> int:
        """Of a run that ended like this."""
        return {Outcome.FINISHED: 0, Outcome.HOME: 0, Outcome.NEEDS_HELP: 3}.get(self, 1)


@dataclass(frozen=True, slots=True)
class PlannerView:
    """The Planner's state, for people: mode, planned path, length of the list of side halls."""

    t_s: Seconds
    mode: Word
    detail: Text
    path_m: PathPoints
    halls_open: Count
    area_m2: SquareMetres
    outcome: Outcome = Outcome.NONE
    valid: bool = True
    command_id: CommandId = 0  # of the newest OperatorCommand that was answered
    refused: bool = False  # that command does nothing
    note: Text = ""  # what its sender should read about it
    paused: bool = False  # by an operator
    blacklisted: Blacklisted = ()  # places that the newest exploration left out, each with its reason


class Operation(Enum):
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    HOME = "home"
    GOTO = "goto"
    # What is drawn on the map (common/zones.py)
    NO_GO_LINE = "no-go-line"
    NO_GO_AREA = "no-go-area"
    ONLY_HERE = "only-here"
    REMOVE_ZONE = "remove-zone"
    POSE = "pose"  # where the robot stands; the mapping unit answers it


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """An operator's command to the mission."""

    t_s: Seconds
    operation: Operation
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    valid: bool = True
    command_id: CommandId = 0  # repeated with the same one until PlannerView acknowledges it; 0 = not acknowledged
    epoch: Epoch = 0  # of a resume: the stop epoch after which the robot may go on
    corners_x_m: ZoneCorners = ()  # of a line or area, in the map
    corners_y_m: ZoneCorners = ()
    zone: Count = 0  # the number of the one to be removed; 0 for all
    heading_rad: Radians = 0.0  # of a pose, with its standard deviations
    sd_m: Spread = 0.0
    sd_heading_rad: Spread = 0.0


@dataclass(frozen=True, slots=True)
class PoseAnswer:
    """What the mapping unit says to the newest pose that a person stated."""

    t_s: Seconds
    command_id: CommandId
    refused: bool
    note: Text
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Zones:
    """All no-go lines and areas, and all areas to stay in, that count now (common/zones.py)."""

    t_s: Seconds
    numbers: ZoneNumbers
    kinds: ZoneKinds
    corner_counts: ZoneNumbers  # of each; their corners stand one after the other
    corners_x_m: AllCorners
    corners_y_m: AllCorners
    valid: bool = True
