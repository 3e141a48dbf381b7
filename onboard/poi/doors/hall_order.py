"""Room numbers along a hall: what breaks the order of its neighbours, and looks like what would keep it, is doubted.

A prior that flags and never overwrites: 283 between 201 and 205 is shown as doubtful, since it may be 203 misread. What
was read from many directions stands, whatever its neighbours say. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from onboard.poi.doors.observations import Sign, same_wall

REACH_M = 8.0  # to the neighbours on either side
OFF_WALL_M = 0.25  # between plates of one wall, out of its plane
STEP_MAX = 8  # between both neighbours of a plate: larger ones are no order
SURE = 4  # directions from which a number was read that needs no neighbours
_LAST_DIGITS = re.compile(r"^(.*?)(\d+)(\D*)$")


def out_of_order(plates: Sequence[Sign]) -> list[Sign]:
    """Plates whose number may be a misread one, by the nearest plates on both sides of each."""
    return [sign for sign in plates if sign.agreeing < SURE and _is_odd(sign, plates)]


def _is_odd(sign: Sign, plates: Sequence[Sign]) -> bool:
    at = sign.place.point
    sides: dict[bool, tuple[float, Sign]] = {}
    for other in plates:
        there = other.place.point
        if other is sign or not same_wall(at, there) or there.off(at) > OFF_WALL_M:
            continue
        along_m = there.right_of(at)
        if abs(along_m) < REACH_M and ((along_m > 0) not in sides or abs(along_m) < sides[along_m > 0][0]):
            sides[along_m > 0] = abs(along_m), other
    if len(sides) < 2:
        return False
    own, left, right = (_parted(one.key) for one in (sign, sides[False][1], sides[True][1]))
    if own is None or left is None or right is None or left[0] != right[0]:
        return False
    low, high = sorted((left[1], right[1]))
    if not 0 < high - low <= STEP_MAX or (own[0] == left[0] and low - STEP_MAX <= own[1] <= high + STEP_MAX):
        return False
    between = (left[0] + str(number).zfill(left[2]) for number in range(low + 1, high))
    return any(_differ_in_one(sign.key, number) for number in between)


def _parted(key: str) -> tuple[str, int, int] | None:
    """What stands before the last digits, their number, and how many they are."""
    match = _LAST_DIGITS.match(key)
    return (match[1], int(match[2]), len(match[2])) if match is not None else None


def _differ_in_one(a: str, b: str) -> bool:
    return len(a) == len(b) and sum(x != y for x, y in zip(a, b, strict=True)) == 1
