"""The specification's tables as pure functions: P1.0 keeps the distance to the walls, P3.0 decides at a junction.

Which branches are open is found by `junction.Junction.choose`, which calls `decide`.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum
from math import pi, radians

from common.constants import HALL_WIDTH_FOR_BOTH_M, MIN_DISTANCE_POI_M, MIN_DISTANCE_TO_WALL_M

SHIFT_MAX_RAD = radians(15.0)  # Table P1.0: o_angle = +-15
SHIFT_GAIN_RAD_PER_M = radians(35.0)
NARROW_TOLERANCE_M = 0.02


def shift_rad(left_m: float, right_m: float) -> float:
    """Table P1.0: by how much to steer left (positive) or right to keep the distances to the walls.

    In a hall too narrow for both distances the middle is kept; in a wider one MIN_DISTANCE_POI_M from the right wall
    (decision 4). The table's fixed 15 degrees is the largest request; nearer to the aim it is less. NaN = no wall.
    """
    left, right = left_m == left_m, right_m == right_m
    if left and right and left_m + right_m < HALL_WIDTH_FOR_BOTH_M:
        error_m = (left_m - right_m) / 2
    elif right and right_m < MIN_DISTANCE_POI_M:
        error_m = MIN_DISTANCE_POI_M - right_m
        if left:
            error_m = min(error_m, max(left_m - MIN_DISTANCE_TO_WALL_M, 0.0))
    else:
        off_left_m = left_m - MIN_DISTANCE_TO_WALL_M if left else 0.0
        off_right_m = MIN_DISTANCE_POI_M - right_m if right else 0.0
        error_m = min(off_left_m, max(off_right_m, -1.0), 0.0)
    if abs(error_m) < NARROW_TOLERANCE_M:
        return 0.0
    return max(-SHIFT_MAX_RAD, min(SHIFT_MAX_RAD, SHIFT_GAIN_RAD_PER_M * error_m))


class Turn(Enum):
    """A branch at a junction; the value is the change of heading in radians."""

    RIGHT = -pi / 2
    FORWARD = 0.0
    LEFT = pi / 2
    BACK = pi


def decide(open_turns: Collection[Turn]) -> Turn:
    """Table P3.0: the right-most open branch; out of a dead end, back.

    The branches that are open too and not taken are the side halls of the table: they stay on the list of
    `frontiers.groups` until somebody has visited them.
    """
    return next((turn for turn in (Turn.RIGHT, Turn.FORWARD, Turn.LEFT) if turn in open_turns), Turn.BACK)
