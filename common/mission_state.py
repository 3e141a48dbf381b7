"""How the mission stands, in words for people: the planner's view and the permit in, one `MissionState` out. Pure.

Page, terminal, command line and `runs` take every word from here, so that they agree. First comes a latched stop, then
a pause, then what the planner does or how its order ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from common.messages.mission import Operation, Outcome, PlannerView
from common.messages.stop import Permit

ENDED = {
    Outcome.FINISHED: "finished, and home",
    Outcome.HOME: "home, as ordered",
    Outcome.ARRIVED: "arrived at the place",
    Outcome.GAVE_UP: "gave up: no path led there",
    Outcome.LOW_BATTERY: "home, for the battery is low",
    Outcome.NEEDS_HELP: "needs help: no way home",
}
STARTED_ALREADY = "The mission is under way already; resume ends a pause."
NOT_PAUSED = "Nothing is paused."
PAUSED_ALREADY = "It was paused already."
STILL_PAUSED = "It is still paused, since before that stop was resumed: resume once more."


class Stage(Enum):
    """The part of the mission that a mode belongs to."""

    WAIT = "wait"
    EXPLORE = "explore"
    RETURN = "return"
    DONE = "done"
    ELSEWHERE = "elsewhere"  # on the way to a place that a person named, or there


# Of the modes of onboard/planner/mission/table.py; every other one explores
_STAGES = {
    "WAITING": Stage.WAIT,
    "HOME": Stage.RETURN,
    "HOME_BLOCKED": Stage.RETURN,
    "ALIGN": Stage.RETURN,
    "GOTO": Stage.ELSEWHERE,
    "GOTO_BLOCKED": Stage.ELSEWHERE,
}
_ENDED_STAGES = {Outcome.FINISHED: Stage.DONE, Outcome.HOME: Stage.RETURN, Outcome.LOW_BATTERY: Stage.RETURN}
_BLOCKED = ("HOME_BLOCKED", "GOTO_BLOCKED")


@dataclass(frozen=True, slots=True)
class MissionState:
    """`text`: what it does, or how it ended; `standing`: why it does not drive, empty where it may; `halls`: open."""

    text: str
    stage: Stage
    standing: str
    halls: str


def started(view: PlannerView) -> bool:
    """Has the planner been given anything to do?"""
    return _stage(view) is not Stage.WAIT


def mission_state(view: PlannerView | None, permit: Permit | None) -> MissionState:
    """With the newest of each, None where none came."""
    if view is None:
        return MissionState("waiting for the planner", Stage.WAIT, _standing(None, permit), "–")
    holds = [word for word, holding in (("stopped", is_stopped(permit)), ("paused", view.paused)) if holding]
    doing = "; " if _rests(view) else " while "
    text = f"{' and '.join(holds)}{doing}{view.detail}" if holds else view.detail
    return MissionState(text, _stage(view), _standing(view, permit), _halls(view))


def is_stopped(permit: Permit | None) -> bool:
    """Is a stop latched, or released and not yet resumed?"""
    return permit is not None and (bool(permit.stop_sources) or not permit.resumed)


def hindrance(operation: Operation, view: PlannerView | None, permit: Permit | None) -> str:
    """Why a command would change nothing now, as one sentence; empty where it would, or where that is not known."""
    if operation is Operation.RESUME and permit is not None and permit.stop_sources:
        return f"The robot is {permit.reason}: release the stop first, then resume."
    if view is None or permit is None:
        return ""
    if operation is Operation.RESUME and not is_stopped(permit) and not view.paused:
        return NOT_PAUSED
    return STARTED_ALREADY if operation is Operation.START and not _rests(view) else ""


def effect(operation: Operation, view: PlannerView | None, permit: Permit | None) -> str:
    """What a command to drive will do, in sentences for whoever is about to give it."""
    if operation is Operation.RESUME:
        return _effect_of_resume(view, permit)
    promise = _PROMISES[operation]
    if permit is None:
        return f"{promise} But nothing is received from the robot."
    if permit.stop_sources:
        return f"{promise} But a stop is latched: nothing moves before its release and a resume."
    if not permit.resumed:
        return f"{promise} But it was stopped: nothing moves before a resume."
    return promise if permit.granted else f"{promise} But it stands now: {permit.reason}."


_PROMISES = {
    Operation.START: "The robot explores the floor and comes home.",
    Operation.HOME: "The robot leaves what is left of its list and drives home.",
    Operation.GOTO: "The robot leaves what it does and drives to that place.",
}


def _effect_of_resume(view: PlannerView | None, permit: Permit | None) -> str:
    paused = view is not None and view.paused
    if is_stopped(permit):
        return f"It ends the stop. {STILL_PAUSED}" if paused else "The robot goes on where it was stopped."
    return "The robot goes on where it was paused." if paused else NOT_PAUSED


def _stage(view: PlannerView) -> Stage:
    if view.mode == "DONE":
        return _ENDED_STAGES.get(view.outcome, Stage.ELSEWHERE)
    return _STAGES.get(view.mode, Stage.EXPLORE)


def _rests(view: PlannerView) -> bool:
    return view.mode in ("WAITING", "DONE")


def _standing(view: PlannerView | None, permit: Permit | None) -> str:
    if permit is None:
        return "no permit was received"
    if not permit.granted:
        return permit.reason or "no permit"
    if view is None:
        return "waiting for the planner"
    if view.paused:
        return "paused"
    return view.detail if _rests(view) or view.mode in _BLOCKED else ""


def _halls(view: PlannerView) -> str:
    if not view.halls_open:
        return "none open"
    return f"{view.halls_open} not visited" if view.mode == "DONE" else f"{view.halls_open} to visit"
