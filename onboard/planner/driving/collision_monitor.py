"""The collision monitor, the specification's emergency routine: stop for what is too near in the direction of motion,
then get away from it.

Runs in every step of the Planner, so on every new ranges, whatever the mission wants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import cos, inf

from common.constants import (
    FOOTPRINT_RADIUS_M,
    PLANNER_CLEARANCE_M,
    SAFE_DISTANCE_M,
    SONAR_BEARINGS_RAD,
    SONAR_FRONT,
    SONAR_FRONT_LEFT,
    SONAR_FRONT_RIGHT,
    SPEED_MEDIUM_M_S,
)
from common.messages.motion import Speed

REACTION_S = 0.25  # age of a range and of a command
BRAKING_M_S2 = 0.3
BLOCKED_S = 1.2  # standing in front of it for so long makes it an obstacle
CLEAR_S = 0.3  # a single lost echo is no all-clear
BACK_OFF_S = 1.3  # requested; the firmware limits how far back the robot drives
AHEAD = (SONAR_FRONT, SONAR_FRONT_LEFT, SONAR_FRONT_RIGHT)


class Phase(Enum):
    CLEAR = "clear"
    STOPPED = "something is near"
    BACKING = "backing off"


@dataclass(frozen=True, slots=True)
class CollisionMonitor:
    """State between ticks: `since_s` is when the phase began, `bearing_rad` where the thing stands."""

    phase: Phase = Phase.CLEAR
    since_s: float = 0.0
    bearing_rad: float = 0.0
    near_s: float = 0.0  # when it was last received


def nearest_ahead(ranges_m: tuple[float, ...], stopping_m: float) -> tuple[float, float]:
    """By how much (metres) the nearest echo ahead is further than where the robot must stop for it, and its bearing;
    infinite where there is none.

    `ranges_m` (5) from the ring's centre, NaN = no echo; `stopping_m`: how far the robot still goes. What a slanted
    sonar hears and the front one does not stands beside the way: an edge of a doorway that is passed.
    """
    return min(
        (
            (ranges_m[i] - FOOTPRINT_RADIUS_M - _limit_m(SONAR_BEARINGS_RAD[i], stopping_m), SONAR_BEARINGS_RAD[i])
            for i in AHEAD
            if ranges_m[i] == ranges_m[i]
        ),
        default=(float("inf"), 0.0),
    )


def _limit_m(bearing_rad: float, stopping_m: float) -> float:
    return (SAFE_DISTANCE_M if bearing_rad else PLANNER_CLEARANCE_M) + stopping_m * cos(bearing_rad)


def stopping_m(speed_m_s: float) -> float:
    """The distance that the robot still goes at this speed before it stands."""
    speed = max(speed_m_s, 0.0)
    return speed * REACTION_S + speed**2 / (2 * BRAKING_M_S2)


def due_s(state: CollisionMonitor) -> float:
    """When its phase may end though no ranges come (s); infinite where it is clear."""
    if state.phase is Phase.BACKING:
        return state.since_s + BACK_OFF_S
    if state.phase is Phase.STOPPED:
        return min(state.since_s + BLOCKED_S, state.near_s + CLEAR_S)
    return inf


def watch(
    state: CollisionMonitor, now_s: float, wanted: Speed, ranges_m: tuple[float, ...], speed_m_s: float
) -> tuple[CollisionMonitor, bool]:
    """Next state, and whether the obstacle has just become one to plan around. `ranges_m` as of `nearest_ahead`."""
    room_m, bearing_rad = nearest_ahead(ranges_m, stopping_m(max(speed_m_s, SPEED_MEDIUM_M_S)))
    near = room_m < 0.0
    forward = wanted in (Speed.MEDIUM, Speed.HIGH)
    stop = CollisionMonitor(Phase.STOPPED, now_s, bearing_rad, now_s)
    if state.phase is Phase.CLEAR:
        return (stop, False) if near and forward else (state, False)
    if state.phase is Phase.BACKING:
        if now_s - state.since_s <= BACK_OFF_S:
            return state, False
        return (stop if near and forward else CollisionMonitor()), False
    if near:
        state = replace(state, near_s=now_s, bearing_rad=bearing_rad)
    elif now_s - state.near_s > CLEAR_S:
        return CollisionMonitor(), False
    if now_s - state.since_s > BLOCKED_S:
        return CollisionMonitor(Phase.BACKING, now_s, state.bearing_rad), True
    return state, False
