"""Another photo of a plate that could not be read (POI_MR_05): drive there, hold, take photos, continue. Pure.

IDLE -> DRIVING (GOTO sent) -> HOLDING (STOP sent) -> IDLE (CONTINUE sent). A spot is visited at most VISITS_MAX times.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import cos, pi, sin

from common.geometry import Pose2, wrap_angle
from common.messages.points_of_interest import PoiCommand
from onboard.poi.placement.wall_line import WallPoint

VISITS_MAX = 2  # of one sign
PLATE_ASIDE_M = 0.25  # from the frame of a door to the middle of its plate
DISTANCE_M = (0.7, 1.5)  # from the wall, as the hall allows
ARRIVED_M, ARRIVED_RAD = 0.5, 0.15  # from the goal
STANDING_M_S, STANDING_RAD_S = 0.03, 0.05  # below both the robot stands
DRIVE_MAX_S = 45.0  # RETAKE_NEAR_M at mapping speed takes 25 s, turns included less than this
HOLD_MAX_S = 8.0  # for PHOTOS frames and their reading
PHOTOS = 3


class Phase(Enum):
    """Where a retake stands."""

    IDLE = "idle"
    DRIVING = "driving"
    HOLDING = "holding"


@dataclass(frozen=True, slots=True)
class Retake:
    """State between steps: where it drives or holds, and since when."""

    phase: Phase = Phase.IDLE
    goal: Pose2 | None = None
    since_s: float = 0.0


def pose_before(spot: WallPoint, distance_m: float) -> Pose2:
    """The pose square to the wall with the camera's axis on the spot, `distance_m` away within DISTANCE_M."""
    d = min(max(distance_m, DISTANCE_M[0]), DISTANCE_M[1])
    return Pose2(
        spot.x_m + d * cos(spot.normal_rad),
        spot.y_m + d * sin(spot.normal_rad),
        wrap_angle(spot.normal_rad - pi / 2),
    )


def plate_spots(centre: WallPoint, width_m: float) -> tuple[WallPoint, WallPoint]:
    """Where the plate of a door hangs that has none on it: to its left and right."""
    aside_m = width_m / 2 + PLATE_ASIDE_M
    return centre.moved_right(-aside_m), centre.moved_right(aside_m)


def begin(goal: Pose2, now_s: float) -> tuple[Retake, PoiCommand]:
    """The first state, and the command for the planner."""
    return Retake(Phase.DRIVING, goal, now_s), PoiCommand.GOTO


def after(
    state: Retake, pose: Pose2, motion: tuple[float, float], photos: int, now_s: float
) -> tuple[Retake, PoiCommand | None]:
    """The state now, and the command for the planner; None where there is none.

    `motion` speed (m/s) and turning rate (rad/s), unsigned; `photos` were taken and read since the hold began.
    """
    age_s = now_s - state.since_s
    if state.phase is Phase.DRIVING:
        assert state.goal is not None
        there = pose.distance_m(state.goal) < ARRIVED_M
        facing = abs(wrap_angle(pose.heading_rad - state.goal.heading_rad)) < ARRIVED_RAD
        standing = motion[0] < STANDING_M_S and motion[1] < STANDING_RAD_S
        if there and facing and standing:
            return Retake(Phase.HOLDING, state.goal, now_s), PoiCommand.STOP
        if age_s > DRIVE_MAX_S:
            return Retake(), PoiCommand.CONTINUE
    elif state.phase is Phase.HOLDING and (photos >= PHOTOS or age_s > HOLD_MAX_S):
        return Retake(), PoiCommand.CONTINUE
    return state, None
