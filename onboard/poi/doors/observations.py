"""Observations of one place on a wall, merged: an edge of a door, or a sign and all its readings.

A place is the mean of its observations. The photos of a sign vote on its text: those of two directions must agree.
"""

from __future__ import annotations

from cmath import rect
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, cos, sin

import numpy as np

from common.geometry import wrap_angle
from onboard.poi.doors.door_detection import Side
from onboard.poi.doors.jamb_lines import JambView
from onboard.poi.placement.map_shift import MapShift
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.sign_reading import SignReading, Verdict

SAME_WALL_RAD = 0.4  # between normals of one wall; walls meet at right angles
AGREEING_MIN = 2  # directions from which the same number was read
SAME_VIEW_RAD = 0.04  # between directions: 5 cm of path at 1.2 m
BLANKS_MAX = 3  # photos without text, after which a candidate is no sign
NUMBERED = (Verdict.PLATE, Verdict.DOUBTFUL)  # verdicts on signs whose number is a vote
MAJORITY = 0.6  # share of the winning number in the confidence of all views


@dataclass(slots=True)
class Place:
    """Mean of the points of all observations; `normal_x`, `normal_y` are the sum of their unit normals."""

    x_m: float
    y_m: float
    normal_x: float
    normal_y: float
    count: int = 1
    seen_s: float = 0.0

    @classmethod
    def of(cls, point: WallPoint, now_s: float) -> Place:
        """The place of a first observation."""
        return cls(point.x_m, point.y_m, cos(point.normal_rad), sin(point.normal_rad), 1, now_s)

    @property
    def point(self) -> WallPoint:
        return WallPoint(self.x_m, self.y_m, atan2(self.normal_y, self.normal_x))

    def add(self, point: WallPoint, now_s: float) -> None:
        """Merges another observation into the mean."""
        self.count, self.seen_s = self.count + 1, now_s
        share = 1.0 / self.count
        self.x_m += share * (point.x_m - self.x_m)
        self.y_m += share * (point.y_m - self.y_m)
        self.normal_x += cos(point.normal_rad)
        self.normal_y += sin(point.normal_rad)


def move(places: Sequence[Place], shift: MapShift) -> None:
    """Moves places with the map, each with the part of it from which it was seen last."""
    was = np.array([[place.x_m, place.y_m, 0.0] for place in places]).reshape(-1, 3)
    for place, (x_m, y_m, turn_rad) in zip(places, shift.moved(was, [p.seen_s for p in places]).tolist(), strict=True):
        place.x_m, place.y_m = x_m, y_m
        normal = complex(place.normal_x, place.normal_y) * rect(1.0, turn_rad)
        place.normal_x, place.normal_y = normal.real, normal.imag


@dataclass(slots=True)
class Edge:
    """An edge of a door: its side and its place. `rising`: previews in which it rose above what hangs on walls, less
    those in which it did not."""

    side: Side
    place: Place
    rising: int = 0

    def vote(self, rises: bool | None) -> None:
        """Counts what one preview shows, if it reaches so high."""
        self.rising += 0 if rises is None else 1 if rises else -1


@dataclass(slots=True)
class Jamb:
    """A jamb by its lines, and what previews showed of it, as `JambView` has it.

    `widths_m`: sum of its widths where it is doubled. `risen`, `doubled`: previews that showed it so. `crossed`,
    `capped`: by side, those in which a line led away from it, less those in which none did.
    """

    place: Place
    widths_m: float = 0.0
    risen: int = 0
    doubled: int = 0
    crossed: Counter[Side] = field(default_factory=Counter)
    capped: Counter[Side] = field(default_factory=Counter)

    def vote(self, view: JambView) -> None:
        """Counts what one preview shows."""
        self.risen += view.risen
        if view.doubled:
            self.doubled += 1
            self.widths_m += view.width_m
        for votes, beside in ((self.crossed, view.crossed), (self.capped, view.capped)):
            for side, leads in zip((Side.LEFT, Side.RIGHT), beside, strict=True):
                votes[side] += 0 if leads is None else 1 if leads else -1

    @property
    def width_m(self) -> float:
        return self.widths_m / max(self.doubled, 1)


@dataclass(slots=True)
class Votes:
    """All readings of one number, by its key: from which directions, the best confidence of each, how they show it.

    Photos from one direction are one view: what hides half a digit there hides it in all of them.
    """

    views: list[tuple[float, float]] = field(default_factory=list)
    shown: Counter[RoomNumber] = field(default_factory=Counter)

    def add(self, bearing_rad: float, confidence: float, number: RoomNumber) -> None:
        self.shown[number] += 1
        self._view(bearing_rad, confidence)

    def join(self, other: Votes) -> None:
        """Takes over the readings of another."""
        self.shown.update(other.shown)
        for view in other.views:
            self._view(*view)

    def _view(self, bearing_rad: float, confidence: float) -> None:
        for i, (view_rad, known) in enumerate(self.views):
            if abs(wrap_angle(view_rad - bearing_rad)) < SAME_VIEW_RAD:
                self.views[i] = view_rad, max(known, confidence)
                return
        self.views.append((bearing_rad, confidence))

    @property
    def weight(self) -> float:
        return sum(confidence for _, confidence in self.views)


@dataclass(slots=True)
class Sign:
    """A sign: its place and all readings of it. `doubt`: why its number does not count yet, empty where it does.

    `damaged`: by the number's key, photos that showed it damaged.
    """

    place: Place
    votes: dict[str, Votes] = field(default_factory=dict)
    damaged: Counter[str] = field(default_factory=Counter)
    blanks: int = 0  # photos on which nothing could be read
    types: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[Verdict] = field(default_factory=Counter)
    doubt: str = ""
    photo: bytes = b""
    photo_quality: float = -1.0
    best_confidence: float = 0.0
    distance_m: float = 1.0  # of the robot from the wall when it was seen last

    def vote(self, reading: SignReading, bearing_rad: float) -> None:
        """Counts one reading of the sign, from a robot in this direction of it."""
        self.verdicts[reading.verdict] += 1
        if reading.number is not None and reading.verdict in NUMBERED:
            self.votes.setdefault(reading.number.key, Votes()).add(bearing_rad, reading.confidence, reading.number)
            self.best_confidence = max(self.best_confidence, reading.confidence)
        if reading.number is not None and reading.damaged:
            self.damaged[reading.number.key] += 1
        if reading.room_type and reading.verdict in (*NUMBERED, Verdict.NAMED):
            self.types[reading.room_type] += 1

    @property
    def read(self) -> RoomNumber | None:
        """The number with the largest sum of confidence over all photos; the first read of equals."""
        best = max(self.votes.values(), key=lambda votes: votes.weight, default=None)
        return best.shown.most_common(1)[0][0] if best is not None else None

    @property
    def number(self) -> str:
        """That number as the plate shows it, empty when none was read, or hardly ever whole."""
        return self.read.shown if self.read is not None and self.legible else ""

    @property
    def legible(self) -> bool:
        """A number was read, from two directions or not more often damaged than whole."""
        if self.read is None:
            return False
        return self.agreed or self.damaged[self.key] <= self.votes[self.key].shown.total()

    @property
    def key(self) -> str:
        return self.read.key if self.read is not None else ""

    @property
    def agreeing(self) -> int:
        """The directions from which photos show this number."""
        return len(self.votes[self.key].views) if self.votes else 0

    @property
    def agreed(self) -> bool:
        """Photos from enough directions agree on the number."""
        return self.agreeing >= AGREEING_MIN and self.share > MAJORITY

    @property
    def accepted(self) -> bool:
        return self.agreed and not self.doubt

    @property
    def share(self) -> float:
        """The share of the winning number in the confidence of all views."""
        total = sum(votes.weight for votes in self.votes.values())
        return self.votes[self.key].weight / total if total else 0.0

    @property
    def room_type(self) -> str:
        return max(self.types, key=lambda kind: self.types[kind]) if self.types else ""

    @property
    def rejected(self) -> bool:
        """A poster: legible, and no plate."""
        return self.verdicts[Verdict.OTHER] > self._plates

    @property
    def is_plate(self) -> bool:
        return bool(self.votes or self.named) and not self.rejected

    @property
    def named(self) -> bool:
        """It names a room and has no number."""
        return not self.votes and self.verdicts[Verdict.NAMED] >= AGREEING_MIN

    @property
    def settled(self) -> bool:
        """Another photo would change nothing."""
        if not self.verdicts:
            return self.blanks >= BLANKS_MAX
        if self.rejected:
            return self.verdicts[Verdict.OTHER] >= AGREEING_MIN + self._plates
        return self.named or (self.agreed and self.agreeing >= AGREEING_MIN + 1)

    @property
    def wants_photo(self) -> bool:
        """It may be a plate and could not be read well enough; a number in doubt is legible."""
        return bool(self.verdicts) and not (self.agreed or self.rejected or self.named)

    @property
    def _plates(self) -> int:
        return (
            self.verdicts[Verdict.PLATE]
            + self.verdicts[Verdict.NAMED]
            + (0 if self.doubt else self.verdicts[Verdict.DOUBTFUL])
        )


def same_wall(a: WallPoint, b: WallPoint) -> bool:
    """Whether both points belong to walls that face the same direction."""
    return abs(wrap_angle(a.normal_rad - b.normal_rad)) < SAME_WALL_RAD
