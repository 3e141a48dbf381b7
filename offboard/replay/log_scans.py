"""A range log as it was written: what the readers of its dialects (`csv_log`, `carmen_log`) hand to `range_log`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.errors import StartError
from common.geometry import FloatArray, Pose2, wrap_angle, wrap_angles

NUMBER_MAX = 1e30  # of any unit of time or length: what is more is none
SHOWN = 30  # characters of a value that a sentence quotes
CENTRE = Pose2(0.0, 0.0, 0.0)

Lines = npt.NDArray[np.int64]


class RangeLogError(StartError):
    """The log cannot be used: one sentence with file, line and what is wrong."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """What a person gives in place of the log's own data; None: the log's own."""

    beams_deg: tuple[float, ...] | None = None
    max_range_m: float | None = None
    field_of_view_deg: float | None = None


@dataclass(frozen=True, slots=True)
class LogText:
    """The lines of a file; `cut`: the last of them has no end, so that a part of it may be missing."""

    path: str
    lines: list[str]
    cut: bool

    def error(self, number: int, reason: str) -> RangeLogError:
        return RangeLogError(f"{self.path}, line {number}: {reason}.")

    def number(self, number: int, text: str) -> float:
        """A finite number in a line; raises RangeLogError."""
        value = self.any_number(number, text)
        if not abs(value) <= NUMBER_MAX:
            raise self.error(number, f"'{shown(text)}' where a finite number must stand; mend the line or delete it")
        return value

    def any_number(self, number: int, text: str) -> float:
        """Like `number`, but `inf` and `nan` are numbers too."""
        try:
            return float(text)
        except ValueError:
            raise self.error(number, f"could not convert '{shown(text)}' to a number") from None

    def rows(
        self, numbers: list[int], columns: int, parse: Callable[[int], list[float]], notes: list[str]
    ) -> tuple[Lines, FloatArray]:
        """The lines with these numbers, as (N,) and (N, columns); a last one that is cut off is left out and noted."""
        kept, rows = [], []
        for number in numbers:
            try:
                rows.append(parse(number))
                kept.append(number)
            except RangeLogError:
                if not (self.cut and number == len(self.lines)):
                    raise
                notes.append(f"line {number} is cut off and was left out")
        return np.array(kept, dtype=np.int64), np.array(rows, dtype=np.float64).reshape(len(rows), columns)


@dataclass(frozen=True, slots=True)
class Scans:
    """`lines` (N,) are their numbers in the file; `stamps` (N,) of any clock, or none at all; odometry `poses` (N, 3).

    `ranges_m` (N, beams) with NaN for no echo, measured from `laser`, the place of the beams' centre on the robot.
    `notes`: sentences about the log, without a full stop.
    """

    lines: Lines
    stamps: FloatArray
    poses: FloatArray
    ranges_m: FloatArray
    bearings_rad: tuple[float, ...]
    laser: Pose2
    notes: list[str]


def shown(text: str) -> str:
    """As much of a text as a sentence can hold."""
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def nearest(bearings_rad: FloatArray, bearing_rad: float) -> tuple[int, float]:
    """Which of the bearings (B,) is nearest to one, and how far off it is (radians)."""
    off_rad = np.abs(wrap_angles(bearings_rad - bearing_rad))
    index = int(off_rad.argmin())
    return index, float(off_rad[index])


def wrapped(bearings_rad: FloatArray) -> tuple[float, ...]:
    return tuple(wrap_angle(b) for b in bearings_rad.tolist())


def note(notes: list[str], lines: list[int], what: str) -> None:
    """Adds what happened in these lines, if there are any."""
    if lines:
        more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
        notes.append(f"line {lines[0]}{more}: {what}")
