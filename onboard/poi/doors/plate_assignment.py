"""Which plate is which door's: doors and plates along a wall in, at most one plate for each door out. Pure.

Where only one door is in reach of a plate, and only this plate in that door's, there is nothing to choose; those pairs
show on which side of doors the plates of this site hang. Where several are in reach, the cheapest assignment of all of
them together counts, in which doors and plates keep their order along the wall.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.door_spans import OFF_WALL_M, Span
from onboard.poi.doors.observations import Sign, same_wall
from onboard.poi.placement.wall_line import WallPoint

PLATE_REACH_M = 0.55  # from a plate to its door's nearest edge
OTHER_SIDE_M = 0.3  # so much further a plate on the unusual side counts
HABIT_MIN, HABIT_SHARE = 4, 0.8  # plates beside doors that show a usual side, and how many hang there

Pair = tuple[int, int]  # indices of a span and of a plate


@dataclass(frozen=True, slots=True)
class Offset:
    """From a door to a plate: 0 on the door; beside it the gap to the nearest edge, and on which side."""

    gap_m: float
    side: Side | None


def offset(span: Span, plate: WallPoint) -> Offset | None:
    """Where a plate hangs, as one looks at the door; None when it cannot be that door's."""
    left, right = span.ends
    if not same_wall(left, plate) or plate.off(left) > OFF_WALL_M:
        return None
    gap_m, side = max((left.right_of(plate), Side.LEFT), (plate.right_of(right), Side.RIGHT), key=lambda one: one[0])
    if gap_m >= PLATE_REACH_M:
        return None
    return Offset(gap_m, side) if gap_m > 0.0 else Offset(0.0, None)


def plates_of(spans: Sequence[Span], plates: Sequence[Sign]) -> dict[int, int]:
    """Index of the span -> index of its plate."""
    offsets = {
        (i, j): found
        for i, span in enumerate(spans)
        for j, plate in enumerate(plates)
        if (found := offset(span, plate.place.point)) is not None
    }
    side = usual_side(offsets)
    costs = {pair: cost for pair, one in offsets.items() if (cost := _cost(one, side)) < PLATE_REACH_M}
    plate_of: dict[int, int] = {}
    for group in _groups(costs):
        origin = spans[group[0][0]].left.place.point

        def along(point: WallPoint, origin: WallPoint = origin) -> float:
            return point.right_of(origin)

        doors = sorted({i for i, _ in group}, key=lambda i: sum(along(end) for end in spans[i].ends))
        signs = sorted({j for _, j in group}, key=lambda j: along(plates[j].place.point))
        plate_of |= _cheapest(doors, signs, costs)
    return plate_of


def usual_side(offsets: dict[Pair, Offset]) -> Side | None:
    """The side of doors on which most plates hang, by the pairs that leave no choice; None where there is no habit."""
    doors, plates = Counter(i for i, _ in offsets), Counter(j for _, j in offsets)
    sides = Counter(one.side for (i, j), one in offsets.items() if doors[i] == plates[j] == 1 and one.side is not None)
    side, count = max(sides.items(), key=lambda item: item[1], default=(None, 0))
    return side if count >= HABIT_MIN and count >= HABIT_SHARE * sides.total() else None


def _cost(one: Offset, usual: Side | None) -> float:
    return one.gap_m + (OTHER_SIDE_M if usual is not None and one.side not in (None, usual) else 0.0)


def _groups(pairs: Iterable[Pair]) -> list[list[Pair]]:
    """Pairs that share doors or plates, directly or through others."""
    groups: list[list[Pair]] = []
    for i, j in pairs:
        joined = [group for group in groups if any(i == a or j == b for a, b in group)]
        groups = [group for group in groups if group not in joined] + [[(i, j), *(p for g in joined for p in g)]]
    return groups


def _cheapest(doors: Sequence[int], plates: Sequence[int], costs: dict[Pair, float]) -> dict[int, int]:
    """The assignment of least cost that keeps both orders; a plate that is left over costs PLATE_REACH_M."""
    # best[d][p]: of the first d doors and the first p plates
    best: list[list[tuple[float, dict[int, int]]]] = [[(PLATE_REACH_M * p, {}) for p in range(len(plates) + 1)]]
    for d, door in enumerate(doors, start=1):
        row = [best[d - 1][0]]
        for p, plate in enumerate(plates, start=1):
            without_plate = row[p - 1][0] + PLATE_REACH_M, row[p - 1][1]
            options = [best[d - 1][p], without_plate]
            if (door, plate) in costs:
                before = best[d - 1][p - 1]
                options.append((before[0] + costs[door, plate], before[1] | {door: plate}))
            row.append(min(options, key=lambda option: option[0]))
        best.append(row)
    return best[-1][-1][1]
