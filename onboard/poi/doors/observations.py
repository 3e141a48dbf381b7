"""Observations of one place on a wall, merged: an edge of a door, or a sign and all its readings.

A place is the mean of its observations. The photos of a sign vote on its text: at least two must agree.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import atan2, cos, sin

from common.geometry import wrap_angle
from onboard.poi.doors.door_detection import Side
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.signs.sign_reading import SignReading, Verdict

SAME_WALL_RAD = 0.4  # between normals of one wall; walls meet at right angles
AGREEING_MIN = 2  # photos with the same number
BLANKS_MAX = 3  # photos without text, after which a candidate is no sign
MAJORITY = 0.6  # share of the winning number in the confidence of all readings


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


@dataclass(slots=True)
class Edge:
    """An edge of a door: its side and its place."""

    side: Side
    place: Place


@dataclass(slots=True)
class Sign:
    """A sign: its place and all readings of it."""

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
        """Counts one reading of the sign."""
        self.verdicts[reading.verdict] += 1
        if reading.verdict is Verdict.PLATE:
            self.numbers[reading.number] += 1
            self.weights[reading.number] = self.weights.get(reading.number, 0.0) + reading.confidence
            self.best_confidence = max(self.best_confidence, reading.confidence)
            if reading.room_type:
                self.types[reading.room_type] += 1

    @property
    def number(self) -> str:
        """The number with the largest sum of confidence over all photos; the first read of equals."""
        return max(self.weights, key=lambda n: self.weights[n]) if self.weights else ""

    @property
    def accepted(self) -> bool:
        """Enough photos agree on the number."""
        number = self.number
        return self.numbers[number] >= AGREEING_MIN and self.share > MAJORITY

    @property
    def share(self) -> float:
        """The share of the winning number in the confidence of all readings."""
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
        """Another photo would change nothing."""
        if not self.verdicts:
            return self.blanks >= BLANKS_MAX
        if self.rejected:
            return self.verdicts[Verdict.OTHER] >= AGREEING_MIN + self.verdicts[Verdict.PLATE]
        return self.accepted and self.numbers[self.number] >= AGREEING_MIN + 1

    @property
    def wants_photo(self) -> bool:
        """It may be a plate and could not be read well enough."""
        return bool(self.verdicts) and not self.accepted and not self.rejected


def same_wall(a: WallPoint, b: WallPoint) -> bool:
    """Whether both points belong to walls that face the same direction."""
    return abs(wrap_angle(a.normal_rad - b.normal_rad)) < SAME_WALL_RAD
