"""The mission's states: modes, events and transitions, in one place and pure. Commands, arrivals and choices in; mode,
outcome, and what is refused with which sentence out.

The mode is what the robot is doing; the outcome is how the newest order ended, the aim which outcome it is on its way
to. A pause stands beside them: it keeps the robot where it is, whatever the mode.

A resume ends one thing. The first one after a latched stop ends that stop (comm grants the permit again) and leaves a
pause as it is; the next one ends the pause. An order to drive (start, home, goto) ends a pause too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from common.messages.mission import Outcome
from common.mission_state import ENDED, NOT_PAUSED, PAUSED_ALREADY, STARTED_ALREADY, STILL_PAUSED


class Mode(Enum):
    """What the mission is about; the value is what people read."""

    WAITING = "waiting for start"
    LOOK = "looking"
    STRAIGHT = "following the hall"
    ROUTE = "driving to a side hall"
    IMAGE = "driving to a wall that the camera has not seen"
    ALONG_WALL = "following a wall that the camera has not seen"
    RETAKE = "driving to where a photo is wanted"
    HOME = "driving home"
    HOME_BLOCKED = "no path home; waiting"
    ALIGN = "home, turning to the first heading"
    GOTO = "driving to a place"
    GOTO_BLOCKED = "no path to that place; waiting"
    DONE = "done"


class Event(Enum):
    """What may happen; the value is a short text for people."""

    # An operator's, or poi's
    START = "start"
    GO_HOME = "home"
    GO_TO = "goto"
    GO_NOWHERE = "goto where no floor is known"
    GO_FORBIDDEN = "goto where a zone keeps it out"
    PAUSE = "pause"
    RESUME_STOP = "resume of a stop"
    RESUME = "resume"
    DETOUR = "another photo is wanted"
    DETOUR_OVER = "that photo is not wanted any more"
    # The permit's
    STOPPED = "a stop is latched"
    STOP_OVER = "the stop is released and resumed"
    BATTERY_LOW = "the battery lasts just for the way home"
    # Of driving
    ARRIVED = "arrived"
    ALIGNED = "turned to the first heading"
    LEG_OVER = "the leg shows nothing more"
    NO_PATH = "no path leads there"
    PATH = "a path leads there again"
    TOO_LONG = "no path for too long"
    KEPT_OUT = "only a zone is in the way"
    DEFERRED = "something keeps it from there"
    GONE = "nothing is left to see there"
    # Of choosing
    TURN = "another heading is to be looked along"
    LIST_UNSURE = "the list may not be empty for good"
    AHEAD = "straight on shows new floor"
    SIDE_HALL = "a side hall is next"
    WALL = "a wall is next"
    WALL_REACHED = "at the wall's beginning"
    EXPLORED = "nothing is left that can be reached"


@dataclass(frozen=True, slots=True)
class State:
    """Where the mission stands."""

    mode: Mode = Mode.WAITING
    outcome: Outcome = Outcome.NONE
    aim: Outcome = Outcome.NONE
    paused: bool = False

    @property
    def text(self) -> str:
        """What it is doing, or how that ended; with pauses and stops it is common/mission_state.py that people read."""
        doing: str = self.mode.value
        return ENDED.get(self.outcome, doing) if self.mode is Mode.DONE else doing

    def __str__(self) -> str:
        return f"mode={self.mode.name} outcome={self.outcome.name} paused={self.paused}"


@dataclass(frozen=True, slots=True)
class Row:
    """In these modes the event leads to mode `to`, None = it stays. A row with `refused`, the reason, has no effect."""

    event: Event
    modes: tuple[Mode, ...]
    to: Mode | None = None
    aim: Outcome | None = None  # None: as before
    outcome: Outcome | None = None  # None: as before; the aim where `reaches_aim`
    reaches_aim: bool = False
    refused: str = ""


EXPLORING = (Mode.LOOK, Mode.STRAIGHT, Mode.ROUTE, Mode.IMAGE, Mode.ALONG_WALL)
VISITING = (Mode.ROUTE, Mode.IMAGE)  # on the way to a place of its own choice, which it may defer
ON_LEG = (Mode.STRAIGHT, Mode.ALONG_WALL)
GOING_HOME = (Mode.HOME, Mode.HOME_BLOCKED, Mode.ALIGN)
GOING_TO_PLACE = (Mode.GOTO, Mode.GOTO_BLOCKED)
BLOCKED = (Mode.HOME_BLOCKED, Mode.GOTO_BLOCKED)
AT_REST = (Mode.WAITING, Mode.DONE)
ALL = tuple(Mode)
UNDER_WAY = tuple(mode for mode in Mode if mode not in AT_REST)
CHOICES = (Event.TURN, Event.AHEAD, Event.SIDE_HALL, Event.WALL, Event.EXPLORED)  # each is worth a line in the log
CHOOSING = (Mode.LOOK, Mode.ROUTE)

TABLE = (
    Row(Event.START, AT_REST, Mode.LOOK, aim=Outcome.FINISHED, outcome=Outcome.NONE),
    Row(Event.START, UNDER_WAY, refused=STARTED_ALREADY),
    Row(
        Event.GO_HOME,
        tuple(mode for mode in Mode if mode not in GOING_HOME),
        Mode.HOME,
        aim=Outcome.HOME,
        outcome=Outcome.NONE,
    ),
    Row(Event.GO_HOME, GOING_HOME, Mode.HOME),
    Row(
        Event.BATTERY_LOW,
        tuple(mode for mode in UNDER_WAY if mode not in GOING_HOME),
        Mode.HOME,
        aim=Outcome.LOW_BATTERY,
        outcome=Outcome.NONE,
    ),
    Row(Event.GO_TO, ALL, Mode.GOTO, aim=Outcome.ARRIVED, outcome=Outcome.NONE),
    Row(Event.GO_NOWHERE, ALL, refused="No floor is known there on which the robot could stand."),
    Row(Event.GO_FORBIDDEN, ALL, refused="A no-go line or area keeps the robot from that place."),
    Row(Event.PAUSE, ALL),
    Row(Event.RESUME_STOP, ALL),
    Row(Event.RESUME, ALL),
    Row(Event.STOPPED, UNDER_WAY, outcome=Outcome.STOPPED),
    Row(Event.STOP_OVER, UNDER_WAY, outcome=Outcome.NONE),
    Row(Event.DETOUR, EXPLORING, Mode.RETAKE),
    Row(Event.DETOUR_OVER, (Mode.RETAKE,), Mode.LOOK),
    Row(Event.ARRIVED, (Mode.ROUTE, Mode.IMAGE, Mode.RETAKE), Mode.LOOK),
    Row(Event.ARRIVED, (Mode.HOME,), Mode.ALIGN),
    Row(Event.ARRIVED, (Mode.GOTO,), Mode.DONE, reaches_aim=True),
    Row(Event.ALIGNED, (Mode.ALIGN,), Mode.DONE, reaches_aim=True),
    Row(Event.LEG_OVER, ON_LEG, Mode.LOOK),
    Row(Event.NO_PATH, (Mode.RETAKE,), Mode.LOOK),
    Row(Event.NO_PATH, (Mode.HOME,), Mode.HOME_BLOCKED),
    Row(Event.NO_PATH, (Mode.GOTO,), Mode.GOTO_BLOCKED),
    Row(Event.PATH, (Mode.HOME_BLOCKED,), Mode.HOME),
    Row(Event.PATH, (Mode.GOTO_BLOCKED,), Mode.GOTO),
    Row(Event.TOO_LONG, (Mode.HOME_BLOCKED,), Mode.DONE, outcome=Outcome.NEEDS_HELP),
    Row(Event.TOO_LONG, (Mode.GOTO_BLOCKED,), Mode.DONE, outcome=Outcome.GAVE_UP),
    Row(Event.KEPT_OUT, (Mode.HOME_BLOCKED,), Mode.DONE, outcome=Outcome.NEEDS_HELP),
    Row(Event.KEPT_OUT, (Mode.GOTO_BLOCKED,), Mode.DONE, outcome=Outcome.GAVE_UP),
    Row(Event.DEFERRED, VISITING, Mode.LOOK),
    Row(Event.GONE, (Mode.ROUTE,), Mode.LOOK),
    Row(Event.TURN, CHOOSING, Mode.LOOK),
    Row(Event.LIST_UNSURE, CHOOSING, Mode.LOOK),
    Row(Event.AHEAD, CHOOSING, Mode.STRAIGHT),
    Row(Event.SIDE_HALL, (*CHOOSING, Mode.STRAIGHT), Mode.ROUTE),
    Row(Event.WALL, CHOOSING, Mode.IMAGE),
    Row(Event.WALL_REACHED, (Mode.LOOK,), Mode.ALONG_WALL),
    Row(Event.EXPLORED, CHOOSING, Mode.HOME),
)
ROW_OF = {(mode, row.event): row for row in TABLE for mode in row.modes}


@dataclass(frozen=True, slots=True)
class Step:
    """The state after an event; `moves`: a mode was entered, be it the same one again. `refused`: the event has
    no effect, and `note` is the reason. Else `note` is a hint for its sender, mostly empty."""

    state: State
    moves: bool = False
    refused: bool = False
    note: str = ""


def after(state: State, event: Event) -> Step:
    """The table, applied. An event that has no row in a mode changes nothing there."""
    row = ROW_OF.get((state.mode, event))
    if row is None:
        return Step(state)
    if row.refused:
        return Step(state, refused=True, note=row.refused)
    if event is Event.RESUME and not state.paused:
        return Step(state, refused=True, note=NOT_PAUSED)
    outcome = state.aim if row.reaches_aim else state.outcome if row.outcome is None else row.outcome
    moved = replace(
        state,
        mode=state.mode if row.to is None else row.to,
        aim=state.aim if row.aim is None else row.aim,
        outcome=outcome,
        paused=_paused(state.paused, event),
    )
    return Step(moved, moves=row.to is not None, note=_note(state, event))


def _note(state: State, event: Event) -> str:
    if not state.paused:
        return ""
    return {Event.RESUME_STOP: STILL_PAUSED, Event.PAUSE: PAUSED_ALREADY}.get(event, "")


def _paused(paused: bool, event: Event) -> bool:
    if event in (Event.START, Event.GO_HOME, Event.GO_TO, Event.RESUME):
        return False
    return paused or event is Event.PAUSE
