"""The types that the message table is written in: what a field may hold, and within which bounds.

The bounds are physical and generous. A value beyond them cannot be a measurement, and no node receives it: the codec
refuses such a message (text alone is cut and cleaned, `plain_text`), when it is published and when it arrives.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated

import numpy as np
import numpy.typing as npt

from common.constants import SONAR_COUNT

CHALLENGE_BYTES = 16  # of what a command is signed over


@dataclass(frozen=True, slots=True)
class Within:
    """From `low` to `high`: a number, or every element of an array. `or_nan`: NaN is a value too, "there is none"."""

    low: float
    high: float
    or_nan: bool = False


@dataclass(frozen=True, slots=True)
class UpTo:
    """At most so many characters, bytes, elements, or rows of an array."""

    count: int


@dataclass(frozen=True, slots=True)
class Formerly:
    """The field's name in recordings of older programs."""

    name: str


@dataclass(frozen=True, slots=True)
class Shape:
    """Of an array or a tuple; a letter, at first place, stands for one and the same length in all of a message."""

    sizes: tuple[str | int, ...]


COORDINATE = Within(-1e5, 1e5)  # metres
_TIME = Within(-1e10, 1e10)  # seconds, on any clock

Seconds = Annotated[float, _TIME]
Age = Annotated[float, Within(0.0, 1e5)]  # seconds
Metres = Annotated[float, COORDINATE]
Range = Annotated[float, Within(0.0, 1e3, or_nan=True)]  # metres; NaN where nothing answered
Radians = Annotated[float, Within(-1e6, 1e6)]  # not wrapped, where it adds up
RadiansPerSecond = Annotated[float, Within(-1e3, 1e3)]
MetresPerSecond = Annotated[float, Within(-100.0, 100.0)]
Spread = Annotated[float, Within(0.0, inf)]  # a standard deviation; infinite where nothing is known
Share = Annotated[float, Within(0.0, 1.0)]
Volts = Annotated[float, Within(0.0, 100.0)]
CpuShare = Annotated[float, Within(0.0, 1e3)]  # of one core
Load = Annotated[float, Within(0.0, 1e4)]  # programs that want a core
Celsius = Annotated[float, Within(-100.0, 300.0, or_nan=True)]  # NaN where nothing measures it
SquareMetres = Annotated[float, Within(0.0, 1e10)]

Ticks = Annotated[int, Within(-(2**31), 2**31 - 1)]  # as the board counts them
Pwm = Annotated[int, Within(-255, 255)]
CommandId = Annotated[int, Within(0, 2**31 - 1)]  # as the board keeps it
Count = Annotated[int, Within(0, 2**53 - 1)]  # one more is still exact in SQLite and in a browser
Identity = Annotated[int, Within(0, 2**63 - 1)]  # drawn at random; nobody counts on from it

WORD_MAX = 100  # characters
Word = Annotated[str, UpTo(WORD_MAX)]
Text = Annotated[str, UpTo(2_000)]

SonarRanges = Annotated[tuple[Range, ...], Shape((SONAR_COUNT,))]
SonarAges = Annotated[tuple[Age, ...], Shape((SONAR_COUNT,))]

_MAP_POINTS = 400_000  # five hours of driving, more than a battery lasts
MapStart = Annotated[int, Within(0, _MAP_POINTS)]
MapPoints = Annotated[npt.NDArray[np.float32], Shape(("N", 2)), UpTo(_MAP_POINTS), COORDINATE]
Marks = Annotated[npt.NDArray[np.uint8], Shape(("N",)), UpTo(_MAP_POINTS), Within(0, 1)]
PathPoints = Annotated[npt.NDArray[np.float32], Shape(("N", 2)), UpTo(2_000), COORDINATE]
_KEY_FRAMES = UpTo(40_000)  # sixteen kilometres of path
Times = Annotated[npt.NDArray[np.float64], Shape(("K",)), _KEY_FRAMES, _TIME]
Poses = Annotated[npt.NDArray[np.float64], Shape(("K", 3)), _KEY_FRAMES, COORDINATE]  # x, y, heading

GRID_CELLS_MAX = 3_000_000  # 170 m by 170 m of 0.1 m
GridSide = Annotated[int, Within(1, 20_000)]  # cells
CellSize = Annotated[float, Within(0.05, 10.0)]  # metres; finer than twice a sonar's step adds no information
GridBytes = Annotated[bytes, UpTo(2_000_000)]

POI_ID_MAX = 5_000
PoiId = Annotated[int, Within(0, POI_ID_MAX)]  # counted from 1
Photo = Annotated[bytes, UpTo(1_000_000)]

Boot = Annotated[int, Within(0, 2**16 - 1)]
Epoch = Annotated[int, Within(0, 2**31 - 1)]  # as the board keeps it
STOPS_MAX = 32  # that are reported at a time
StopSources = Annotated[tuple[Word, ...], Shape(("S",)), UpTo(STOPS_MAX)]
StopIds = Annotated[tuple[Identity, ...], Shape(("I",)), UpTo(STOPS_MAX)]
StopNames = Annotated[tuple[Word, ...], Shape(("I",)), UpTo(STOPS_MAX)]
Blacklisted = Annotated[tuple[Word, ...], Shape(("G",)), UpTo(50)]

ZONES_MAX, CORNERS_MAX = 50, 50  # lines and areas that a person drew, and corners of each
ZoneCorners = Annotated[tuple[Metres, ...], Shape(("C",)), UpTo(CORNERS_MAX)]
AllCorners = Annotated[tuple[Metres, ...], Shape(("C",)), UpTo(ZONES_MAX * CORNERS_MAX)]
ZoneNumbers = Annotated[tuple[Count, ...], Shape(("Z",)), UpTo(ZONES_MAX)]
ZoneKinds = Annotated[tuple[Word, ...], Shape(("Z",)), UpTo(ZONES_MAX)]

_NOTED = UpTo(1_000)  # doors that a person said something of
DoorIds = Annotated[tuple[PoiId, ...], Shape(("D",)), _NOTED]
DoorPlaces = Annotated[tuple[Metres, ...], Shape(("D",)), _NOTED]
DoorTexts = Annotated[tuple[Word, ...], Shape(("D",)), _NOTED]

Challenge = Annotated[bytes, UpTo(CHALLENGE_BYTES)]
ErrorNumber = Annotated[int, Within(0, 65_535)]
Piece = Annotated[bytes, UpTo(1_000_000)]
RowsBytes = Annotated[int, Within(0, 32_000_000)]  # of the outbox that are on their way together

# What was published under the shared clock: topics with their boot ids and sequence numbers
_TOPICS = UpTo(256)
Topics = Annotated[tuple[Word, ...], Shape(("T",)), _TOPICS]
BootIds = Annotated[tuple[Identity, ...], Shape(("T",)), _TOPICS]
Sequences = Annotated[tuple[Count, ...], Shape(("T",)), _TOPICS]
Pace = Annotated[float, Within(0.0, 1e6)]  # of simulated time
