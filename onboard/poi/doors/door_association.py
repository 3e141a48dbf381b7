"""Data association: edges and signs of all walls in, doors with their plates out.

A door is a left and a right edge on one wall, as far apart as a door is wide, each observed more than once. A plate
belongs to the nearest door of its wall; a plate without a whole door makes a door of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import atan2, cos, sin

from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.door_spans import JAMBS_MIN, OFF_WALL_M, Backed, Span, door_spans, same_place
from onboard.poi.doors.observations import Edge, Jamb, Place, Sign, same_wall
from onboard.poi.doors.plate_assignment import PLATE_REACH_M, offset, plates_of
from onboard.poi.placement.wall_line import WallPoint

USUAL_WIDTH_M = 1.06  # where only one edge is known
OBSERVATIONS_MIN = 2  # of an edge: one alone is often noise
OBSERVATIONS_UNREAD_MIN = 4  # of each edge of a door without a plate
SAME_DOOR_M = 0.6  # two that stand nearer are one, observed twice
SAME_NUMBER_M = 1.2  # the same, when both have one number

PLATE_HALF_M = 0.11  # from the middle of a plate to its rims
NO_JAMB_M = 0.3  # so much further away an edge counts that does not run through the picture as a jamb does
AROUND_PLATE_M = 0.25  # on each side, where its wall is looked for


class State(Enum):
    """How well the number of a door is known."""

    READ = "read"
    DOUBTFUL = "doubtful"  # a number was read, but not often or not clearly enough
    UNREAD = "unread"


@dataclass(frozen=True, slots=True)
class Door:
    """A door as known now; `sign` is its plate, if any. `seen_s`: time of the newest observation of any part."""

    centre: WallPoint
    width_m: float
    sign: Sign | None
    edges: tuple[Edge, ...]
    seen_s: float

    @property
    def state(self) -> State:
        if self.sign is None or not self.sign.legible:
            return State.UNREAD
        return State.READ if self.sign.accepted else State.DOUBTFUL


def associated(
    edges: list[Edge], jambs: list[Jamb], handles: list[Place], signs: list[Sign], backed: Backed
) -> list[Door]:
    """Doors with their plates, and plates that stand alone. `backed`: is there wall between a left and a right point?

    What was read where the map has no wall hangs elsewhere: beyond an opening, or past a corner.
    """
    well_seen = [e for e in edges if e.place.count >= OBSERVATIONS_MIN]
    spans = door_spans(well_seen, jambs, handles, backed)
    plates = _distinct_plates([s for s in signs if s.is_plate and _on_wall(s.place.point, backed)])
    plate_of = plates_of(spans, plates)
    posters = [s for s in signs if s.rejected]
    doors = [
        _door(span.left, span.right, plates[plate_of[i]] if i in plate_of else None)
        for i, span in enumerate(spans)
        if i in plate_of or _well_observed(span, posters)
    ]
    taken = set(plate_of.values())
    # Without a door around it, a number in doubt may be a year on a poster, and a room's name a direction
    alone = [
        _door_of_plate(plate, well_seen, jambs, backed)
        for j, plate in enumerate(plates)
        if j not in taken and plate.votes and not plate.doubt
    ]
    return _distinct(doors + alone)


def _on_wall(plate: WallPoint, backed: Backed) -> bool:
    return backed(plate.moved_right(-AROUND_PLATE_M), plate.moved_right(AROUND_PLATE_M))


def _well_observed(span: Span, posters: list[Sign]) -> bool:
    """A door without a plate counts when its edges were observed often, and look like a door's.

    Around a poster they may be those of a board, unless they rise above what hangs on walls.
    """
    left, right = span.left, span.right
    if not span.sure or min(left.place.count, right.place.count) < OBSERVATIONS_UNREAD_MIN:
        return False
    around = any((at := offset(span, poster.place.point)) is not None and at.side is None for poster in posters)
    return min(left.rising, right.rising) > 0 or not around


def _door_of_plate(plate: Sign, edges: list[Edge], jambs: list[Jamb], backed: Backed) -> Door:
    """The door of a plate without a pair of edges: placed by the nearest edge, without one by the plate itself.

    An edge leads to a place for a door only where the map has wall there. One on the plate is the plate's own.
    """
    at = plate.place.point
    best: tuple[float, Edge] | None = None
    for edge in edges:
        e = edge.place.point
        if not same_wall(e, at) or e.off(at) > OFF_WALL_M:
            continue
        # Outside the door a plate hangs left of a left edge or right of a right one
        outwards_m = at.right_of(e) * (1.0 if edge.side is Side.RIGHT else -1.0)
        if not -USUAL_WIDTH_M < outwards_m < PLATE_REACH_M or abs(outwards_m) < PLATE_HALF_M:
            continue
        is_jamb = any(jamb.place.count >= JAMBS_MIN and same_place(jamb.place, edge.place) for jamb in jambs)
        away_m = abs(outwards_m) + (0.0 if is_jamb else NO_JAMB_M)
        if (best is None or away_m < best[0]) and backed(*_usual_door(edge)):
            best = (away_m, edge)
    if best is None:
        return Door(at, 0.0, plate, (), plate.place.seen_s)
    edge = best[1]
    centre = _usual_door(edge)[0].moved_right(USUAL_WIDTH_M / 2)
    return Door(centre, USUAL_WIDTH_M, plate, (edge,), max(edge.place.seen_s, plate.place.seen_s))


def _usual_door(edge: Edge) -> tuple[WallPoint, WallPoint]:
    """Left and right end of a door of the usual width with this edge."""
    e = edge.place.point
    return (e, e.moved_right(USUAL_WIDTH_M)) if edge.side is Side.LEFT else (e.moved_right(-USUAL_WIDTH_M), e)


def _distinct_plates(plates: list[Sign]) -> list[Sign]:
    """Without the worse read of two plates that lie near each other with one number: one plate, placed twice."""
    kept: list[Sign] = []
    for plate in sorted(plates, key=lambda s: s.agreeing, reverse=True):
        twins = (other for other in kept if other.key == plate.key != "")
        if not any(other.place.point.distance_m(plate.place.point) < SAME_NUMBER_M for other in twins):
            kept.append(plate)
    return kept


def _distinct(doors: list[Door]) -> list[Door]:
    """Without duplicates, which arise when the map moves: keeps the better read door, then the better observed one."""

    def strength(door: Door) -> tuple[int, int, int]:
        sign = door.sign
        return (
            sign.agreeing if sign is not None else 0,
            len(door.edges),
            min((e.place.count for e in door.edges), default=0),
        )

    keys_read = {door.sign.key for door in doors if door.sign is not None and door.state is State.READ}
    kept: list[Door] = []
    for door in sorted(doors, key=strength, reverse=True):
        key = door.sign.key if door.sign is not None else ""
        if door.state is State.DOUBTFUL and key in keys_read:
            continue  # the same plate, misplaced once
        for other in kept:
            reach_m = SAME_DOOR_M
            if key and other.sign is not None and other.sign.key == key:
                reach_m = SAME_NUMBER_M
            if same_wall(door.centre, other.centre) and door.centre.distance_m(other.centre) < reach_m:
                break
        else:
            kept.append(door)
    return kept


def _door(left: Edge, right: Edge, sign: Sign | None) -> Door:
    a, b = left.place.point, right.place.point
    normal_rad = atan2(sin(a.normal_rad) + sin(b.normal_rad), cos(a.normal_rad) + cos(b.normal_rad))
    centre = WallPoint((a.x_m + b.x_m) / 2, (a.y_m + b.y_m) / 2, normal_rad)
    seen_s = max(left.place.seen_s, right.place.seen_s, sign.place.seen_s if sign is not None else 0.0)
    return Door(centre, b.right_of(a), sign, (left, right), seen_s)
