"""One record per door: sightings of edges and readings of plates in, doors with number, place and best photo out.

A door is a left and a right edge on one wall, as far apart as a door is wide, each seen more than once. A plate belongs
to the nearest door of its wall. What a plate says is put to the vote of its photos: at least two must agree. Pure: the
node decides when a door is told and when another photo is asked for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from math import atan2, cos, sin

from common.geometry import wrap_angle
from onboard.poi.door_detection import Side
from onboard.poi.sign_placement import WallPoint
from onboard.poi.sign_reading import SignReading, Verdict

EDGE_GATE_M = 0.15  # sightings of one edge; doors stand further apart
SIGN_GATE_M = 0.30  # readings of one sign
SAME_WALL_RAD = 0.4
OFF_WALL_M = 0.25
DOOR_WIDTH_M = (0.65, 1.45)  # between the outer edges of the frame
USUAL_WIDTH_M = 1.06
PLATE_REACH_M = 0.55  # from a plate to its door's nearest edge
SIGHTINGS_MIN = 2
SIGHTINGS_UNREAD_MIN = 4  # of the edges of a door that nothing else speaks for
AGREEING_MIN = 2
BLANKS_MAX = 3
SAME_DOOR_M = 0.6  # two that stand nearer are one, seen twice
SAME_NUMBER_M = 1.2
MAJORITY = 0.6


class State(Enum):
    READ = "read"
    DOUBTFUL = "doubtful"  # a number was read, but not often or not clearly enough
    UNREAD = "unread"


@dataclass(slots=True)
class Place:
    """Mean of the points where one thing was seen."""

    x_m: float
    y_m: float
    normal_x: float
    normal_y: float
    count: int = 1
    seen_s: float = 0.0

    @classmethod
    def of(cls, point: WallPoint, now_s: float) -> Place:
        return cls(point.x_m, point.y_m, cos(point.normal_rad), sin(point.normal_rad), 1, now_s)

    @property
    def point(self) -> WallPoint:
        return WallPoint(self.x_m, self.y_m, atan2(self.normal_y, self.normal_x))

    def add(self, point: WallPoint, now_s: float) -> None:
        self.count, self.seen_s = self.count + 1, now_s
        share = 1.0 / self.count
        self.x_m += share * (point.x_m - self.x_m)
        self.y_m += share * (point.y_m - self.y_m)
        self.normal_x += cos(point.normal_rad)
        self.normal_y += sin(point.normal_rad)


@dataclass(slots=True)
class Edge:
    side: Side
    place: Place


@dataclass(slots=True)
class Sign:
    """Everything read at one spot of a wall."""

    place: Place
    numbers: Counter[str] = field(default_factory=Counter)
    weights: dict[str, float] = field(default_factory=dict)
    blanks: int = 0  # photos on which nothing could be read
    types: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[Verdict] = field(default_factory=Counter)
    photo: bytes = b""
    photo_quality: float = -1.0
    best_confidence: float = 0.0
    distance_m: float = 1.0  # of the robot from the wall when it was seen last

    def vote(self, reading: SignReading) -> None:
        self.verdicts[reading.verdict] += 1
        if reading.verdict is Verdict.PLATE:
            self.numbers[reading.number] += 1
            self.weights[reading.number] = self.weights.get(reading.number, 0.0) + reading.confidence
            self.best_confidence = max(self.best_confidence, reading.confidence)
            if reading.room_type:
                self.types[reading.room_type] += 1

    @property
    def number(self) -> str:
        """What most photos say, weighted by their confidence; the first read of equals."""
        return max(self.weights, key=lambda n: self.weights[n]) if self.weights else ""

    @property
    def accepted(self) -> bool:
        number = self.number
        return self.numbers[number] >= AGREEING_MIN and self.share > MAJORITY

    @property
    def share(self) -> float:
        total = sum(self.weights.values())
        return self.weights[self.number] / total if total else 0.0

    @property
    def room_type(self) -> str:
        return max(self.types, key=lambda kind: self.types[kind]) if self.types else ""

    @property
    def rejected(self) -> bool:
        """A poster: legible, and no plate."""
        return self.verdicts[Verdict.OTHER] > self.verdicts[Verdict.PLATE]

    @property
    def is_plate(self) -> bool:
        return bool(self.numbers) and not self.rejected

    @property
    def settled(self) -> bool:
        """Another photo would tell nothing new."""
        if not self.verdicts:
            return self.blanks >= BLANKS_MAX
        if self.rejected:
            return self.verdicts[Verdict.OTHER] >= AGREEING_MIN + self.verdicts[Verdict.PLATE]
        return self.accepted and self.numbers[self.number] >= AGREEING_MIN + 1

    @property
    def wants_photo(self) -> bool:
        """It may be a plate and could not be read well enough."""
        return bool(self.verdicts) and not self.accepted and not self.rejected


@dataclass(frozen=True, slots=True)
class Door:
    """A door as known now; `sign` is its plate, None where none was seen. `seen_s`: when anything of it was seen."""

    centre: WallPoint
    width_m: float
    sign: Sign | None
    edges: tuple[Edge, ...]
    seen_s: float

    @property
    def state(self) -> State:
        if self.sign is None or not self.sign.numbers:
            return State.UNREAD
        return State.READ if self.sign.accepted else State.DOUBTFUL


class DoorRecords:
    """All edges and signs of the floor. `doors()` joins them anew at every call."""

    def __init__(self, backed: Callable[[WallPoint, WallPoint], bool]) -> None:
        """`backed`: is there wall between a left and a right edge?"""
        self._backed = backed
        self.edges: list[Edge] = []
        self.signs: list[Sign] = []

    def add_edge(self, side: Side, point: WallPoint, now_s: float) -> None:
        near = [e for e in self.edges if e.side is side and _same_wall(e.place.point, point)]
        edge = min(near, key=lambda e: e.place.point.distance_m(point), default=None)
        if edge is not None and edge.place.point.distance_m(point) < EDGE_GATE_M:
            edge.place.add(point, now_s)
        else:
            self.edges.append(Edge(side, Place.of(point, now_s)))

    def sign_at(self, point: WallPoint) -> Sign | None:
        near = [s for s in self.signs if _same_wall(s.place.point, point)]
        sign = min(near, key=lambda s: s.place.point.distance_m(point), default=None)
        return sign if sign is not None and sign.place.point.distance_m(point) < SIGN_GATE_M else None

    def add_sign(self, point: WallPoint, now_s: float, reading: SignReading | None = None) -> Sign:
        """Something that may be a sign was seen, or read, at a spot."""
        sign = self.sign_at(point)
        if sign is None:
            sign = Sign(Place.of(point, now_s))
            self.signs.append(sign)
        else:
            sign.place.add(point, now_s)
        if reading is not None:
            sign.vote(reading)
        return sign

    def add_blank(self, point: WallPoint, now_s: float) -> None:
        """What looked like a sign held no text."""
        sign = self.sign_at(point)
        if sign is None:
            sign = self.add_sign(point, now_s)
        sign.blanks += 1

    def doors(self) -> list[Door]:
        """Doors with their plates, and plates that stand alone."""
        spans = [
            (left, right)
            for left, right in _spans([e for e in self.edges if e.place.count >= SIGHTINGS_MIN])
            if self._backed(left.place.point, right.place.point)
        ]
        plates = _distinct_plates([s for s in self.signs if s.is_plate])
        mine: dict[int, Sign] = {}
        alone = []
        # The nearest pairs first: a door has one plate, and a plate one door
        pairs = sorted(
            (gap_m, i, j)
            for i, (left, right) in enumerate(spans)
            for j, plate in enumerate(plates)
            if (gap_m := _gap_m(left.place.point, right.place.point, plate.place.point)) is not None
        )
        taken: set[int] = set()
        for _, i, j in pairs:
            if i not in mine and j not in taken:
                mine[i] = plates[j]
                taken.add(j)
        alone = [plate for j, plate in enumerate(plates) if j not in taken]
        doors = [
            _door(left, right, mine.get(i))
            for i, (left, right) in enumerate(spans)
            if i in mine or self._speaks_for_itself(left, right)
        ]
        return _distinct(doors + [self._door_of_plate(plate) for plate in alone])

    def _speaks_for_itself(self, left: Edge, right: Edge) -> bool:
        """A door without a plate: seen well, and not the outline of a poster and what is beside it."""
        a, b = left.place.point, right.place.point
        posters = (sign for sign in self.signs if sign.rejected)
        return min(left.place.count, right.place.count) >= SIGHTINGS_UNREAD_MIN and not any(
            _gap_m(a, b, poster.place.point) == 0.0 for poster in posters
        )

    def _door_of_plate(self, plate: Sign) -> Door:
        """A plate whose door was not seen whole: one edge tells where the door is, on it or beside it nothing does."""
        at = plate.place.point
        best: tuple[float, Edge] | None = None
        for edge in self.edges:
            e = edge.place.point
            if edge.place.count < SIGHTINGS_MIN or not _same_wall(e, at) or e.off(at) > OFF_WALL_M:
                continue
            # Outside the door a plate hangs left of a left edge or right of a right one
            outwards_m = at.right_of(e) * (1.0 if edge.side is Side.RIGHT else -1.0)
            if -USUAL_WIDTH_M < outwards_m < PLATE_REACH_M and (best is None or abs(outwards_m) < best[0]):
                best = (abs(outwards_m), edge)
        if best is None:
            return Door(at, 0.0, plate, (), plate.place.seen_s)
        edge = best[1]
        e = edge.place.point
        inwards_m = (USUAL_WIDTH_M / 2) * (1.0 if edge.side is Side.LEFT else -1.0)
        centre = WallPoint(e.x_m - inwards_m * sin(e.normal_rad), e.y_m + inwards_m * cos(e.normal_rad), e.normal_rad)
        return Door(centre, USUAL_WIDTH_M, plate, (edge,), max(edge.place.seen_s, plate.place.seen_s))


def _distinct_plates(plates: list[Sign]) -> list[Sign]:
    """Without those that say the same as a better read one near it: one plate, placed twice."""
    kept: list[Sign] = []
    for plate in sorted(plates, key=lambda s: s.numbers[s.number], reverse=True):
        twins = (other for other in kept if other.number == plate.number)
        if not any(other.place.point.distance_m(plate.place.point) < SAME_NUMBER_M for other in twins):
            kept.append(plate)
    return kept


def _distinct(doors: list[Door]) -> list[Door]:
    """Without those that are another one seen again after the map had moved: the better read, then the better seen."""

    def strength(door: Door) -> tuple[int, int, int]:
        sign = door.sign
        return (
            sign.numbers[sign.number] if sign is not None else 0,
            len(door.edges),
            min((e.place.count for e in door.edges), default=0),
        )

    believed = {door.sign.number for door in doors if door.sign is not None and door.state is State.READ}
    kept: list[Door] = []
    for door in sorted(doors, key=strength, reverse=True):
        number = door.sign.number if door.sign is not None else ""
        if door.state is State.DOUBTFUL and number in believed:
            continue  # the same plate, seen once from where it could not be placed
        for other in kept:
            reach_m = SAME_DOOR_M
            if number and other.sign is not None and other.sign.number == number:
                reach_m = SAME_NUMBER_M
            if _same_wall(door.centre, other.centre) and door.centre.distance_m(other.centre) < reach_m:
                break
        else:
            kept.append(door)
    return kept


def _same_wall(a: WallPoint, b: WallPoint) -> bool:
    return abs(wrap_angle(a.normal_rad - b.normal_rad)) < SAME_WALL_RAD


def _spans(edges: list[Edge]) -> list[tuple[Edge, Edge]]:
    """Pairs of a left and a right edge that are a door; of several the best seen, then the widest. Each edge once."""
    pairs = []
    for i, left in enumerate(edges):
        if left.side is not Side.LEFT:
            continue
        for j, right in enumerate(edges):
            if right.side is not Side.RIGHT or not _same_wall(left.place.point, right.place.point):
                continue
            width_m = right.place.point.right_of(left.place.point)
            if DOOR_WIDTH_M[0] <= width_m <= DOOR_WIDTH_M[1] and right.place.point.off(left.place.point) < OFF_WALL_M:
                pairs.append((-min(left.place.count, right.place.count), -width_m, i, j))
    used: set[int] = set()
    spans = []
    for _, _, i, j in sorted(pairs):
        if i not in used and j not in used:
            used |= {i, j}
            spans.append((edges[i], edges[j]))
    return spans


def _gap_m(left: WallPoint, right: WallPoint, plate: WallPoint) -> float | None:
    """From a plate to the nearest edge of a door, 0 on the door; None when it cannot be that door's."""
    if not _same_wall(left, plate) or plate.off(left) > OFF_WALL_M:
        return None
    outside_m = max(left.right_of(plate), plate.right_of(right), 0.0)
    return outside_m if outside_m < PLATE_REACH_M else None


def _door(left: Edge, right: Edge, sign: Sign | None) -> Door:
    a, b = left.place.point, right.place.point
    normal_rad = atan2(sin(a.normal_rad) + sin(b.normal_rad), cos(a.normal_rad) + cos(b.normal_rad))
    centre = WallPoint((a.x_m + b.x_m) / 2, (a.y_m + b.y_m) / 2, normal_rad)
    seen_s = max(left.place.seen_s, right.place.seen_s, sign.place.seen_s if sign is not None else 0.0)
    return Door(centre, b.right_of(a), sign, (left, right), seen_s)
