"""The specification's tables as pure functions: P1.0 keeps the distance to the walls, P3.0 decides at a junction."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import radians

from common.constants import HALL_WIDTH_FOR_BOTH_M, MIN_DISTANCE_POI_M, MIN_DISTANCE_TO_WALL_M

SHIFT_MAX_RAD = radians(15.0)  # Table P1.0: o_angle = +-15
SHIFT_GAIN_RAD_PER_M = radians(35.0)
NARROW_TOLERANCE_M = 0.02


def shift_rad(left_m: float, right_m: float) -> float:
    """Table P1.0: by how much to steer left (positive) or right to keep the distances to the walls.

    In a hall too narrow for both distances the middle is kept; in a wider one MIN_DISTANCE_POI_M from the right wall
    (decision 4). The table's fixed 15 degrees is the most that is asked; nearer to the aim it is less. NaN = no wall.
    """
    left, right = left_m == left_m, right_m == right_m
    if left and right and left_m + right_m < HALL_WIDTH_FOR_BOTH_M:
        error_m = (left_m - right_m) / 2
    elif right and right_m < MIN_DISTANCE_POI_M:
        error_m = MIN_DISTANCE_POI_M - right_m
        if left:
            error_m = min(error_m, max(left_m - MIN_DISTANCE_TO_WALL_M, 0.0))
    elif left and left_m < MIN_DISTANCE_TO_WALL_M:
        error_m = left_m - MIN_DISTANCE_TO_WALL_M
    elif right and right_m > MIN_DISTANCE_POI_M:
        error_m = max(MIN_DISTANCE_POI_M - right_m, -1.0)
    else:
        return 0.0
    if abs(error_m) < NARROW_TOLERANCE_M:
        return 0.0
    return max(-SHIFT_MAX_RAD, min(SHIFT_MAX_RAD, SHIFT_GAIN_RAD_PER_M * error_m))


class Turn(Enum):
    FORWARD = "forward"
    LEFT = "left"
    RIGHT = "right"
    BACK = "back"


@dataclass(frozen=True, slots=True)
class Junction:
    """What stands around: a wall, or a way on."""

    wall_right: bool
    wall_front: bool
    wall_left: bool


def decide(junction: Junction) -> tuple[Turn, tuple[Turn, ...]]:
    """Table P3.0: which way to take, and which ways go on the list of side halls.

    The right-most open way is taken. A dead end (case 3 with a wall on the left all the way) is left by turning twice.
    """
    ways = [
        way
        for way, wall in (
            (Turn.RIGHT, junction.wall_right),
            (Turn.FORWARD, junction.wall_front),
            (Turn.LEFT, junction.wall_left),
        )
        if not wall
    ]
    if not ways:
        return Turn.BACK, ()
    return ways[0], tuple(ways[1:])
