"""Range logs of any carrier, of either dialect (`csv_log`, `carmen_log`) -> `RangeLog`.

What the log states of itself is accepted; then its clock, its odometry and its ranges must be such that a robot
indoors may have made them. What is not is mended and reported (`notes`), or refused. docs/range-logs.md has the list.
"""

from __future__ import annotations

import codecs
import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.geometry import FloatArray, wrap_angles
from offboard.replay.carmen_log import line_kinds, read_carmen
from offboard.replay.csv_log import read_csv
from offboard.replay.log_clock import MOVED_M, steady
from offboard.replay.log_odometry import Mask, Trust, in_radians
from offboard.replay.log_scans import Lines, LogText, RangeLogError, ReadOptions, Scans
from offboard.replay.range_delay import poses_at, range_delay_s

__all__ = ["RangeLog", "RangeLogError", "read_range_log"]

SIZE_MAX_BYTES = 1 << 28
RANGE_USUAL_MAX_M = 30.0  # half of all ranges indoors are shorter
STEP_USUAL_MAX_M = 2.0
BEGUN_MAX_SHARE = 0.05
SILENT_MIN, SILENT_SHARE = 20, 0.01  # how often the longest range of a log recurs that is no echo at all
SILENT_TIMES = 5  # so many times as often as any that is a little shorter
SILENT_BELOW_M = 1.0


@dataclass(frozen=True, slots=True)
class RangeLog:
    """`times_s` (N,), odometry `poses` (N, 3), `ranges_m` (N, beams) with NaN for no echo, `bearings_rad` (beams,).

    The beams start at `centre_m` (2,) on the robot; `lines` (N,) are the scans' numbers in the file. `goes_on` (N,) is
    false where it is not known how a pose lies to the one before. `notes`: what was found and mended, a sentence each.
    """

    times_s: FloatArray
    poses: FloatArray
    ranges_m: FloatArray
    bearings_rad: tuple[float, ...]
    lines: Lines
    goes_on: Mask
    centre_m: FloatArray
    notes: tuple[str, ...]

    @property
    def range_step_m(self) -> float:
        """The step that the ranges are rounded to; 0 when they are not."""
        distances_m = np.unique(np.round(self.ranges_m[np.isfinite(self.ranges_m)], 5))
        gaps = np.diff(distances_m)
        return float(gaps.min()) if len(gaps) and gaps.min() >= 0.005 else 0.0

    @property
    def step_m(self) -> float:
        """From scan to scan of a robot that drives."""
        return _usual_step_m(self.poses)


def read_range_log(
    path: Path,
    beams_deg: tuple[float, ...] | None = None,
    max_range_m: float | None = None,
    field_of_view_deg: float | None = None,
) -> RangeLog:
    """The log in a file; an argument that is given replaces the log's own value. Raises RangeLogError.

    `beams_deg` picks beams; ranges from `max_range_m` on are no echo; `field_of_view_deg` is that of FLASER lines.
    """
    text = _read(path)
    options = ReadOptions(beams_deg, max_range_m, field_of_view_deg)
    kinds = line_kinds(text.lines)
    scans = read_carmen(text, kinds, options) if kinds else read_csv(text, options)
    if len(scans.lines) < 2:
        raise RangeLogError(f"{path} holds too few scans, {len(scans.lines)}; a map needs two at least.")
    if options.max_range_m is not None:
        scans.ranges_m[scans.ranges_m >= options.max_range_m] = np.nan
    return _judged(text, scans)


def _read(path: Path) -> LogText:
    try:
        with path.open("rb") as file:
            packed = file.peek(2)[:2] == b"\x1f\x8b"
            with gzip.open(file) if packed else file as plain:
                data = plain.read(SIZE_MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RangeLogError(f"The log {path} cannot be read: {reason}.") from error
    if len(data) > SIZE_MAX_BYTES:
        raise RangeLogError(f"The log {path} is longer than {SIZE_MAX_BYTES >> 20} MiB; cut it into pieces.")
    text = _decoded(data)
    if "\0" in text:
        raise RangeLogError(f"The log {path} cannot be read: it is no text.")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    cut = bool(lines[-1])
    return LogText(str(path), lines if cut else lines[:-1], cut)


def _decoded(data: bytes) -> str:
    """What is not Unicode is Latin-1, which has a letter for every byte: only comments hold any."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _judged(text: LogText, scans: Scans) -> RangeLog:
    notes = scans.notes
    _check_ranges(text, scans)
    ranges_m = scans.ranges_m
    _silence(ranges_m, notes)
    poses = in_radians(scans.poses, notes)
    if _usual_step_m(poses) > STEP_USUAL_MAX_M:
        raise text.error(
            int(scans.lines[1]),
            f"from here on odometry moves by {_usual_step_m(poses):.3g} m from scan to scan; it must be in metres, "
            f"with scans less than {STEP_USUAL_MAX_M:g} m apart",
        )
    times_s = steady(scans.stamps, _steps_m(poses), scans.lines, notes)
    poses, goes_on = Trust(times_s, poses, ranges_m, scans.lines, notes).judge()
    begun = np.flatnonzero(~goes_on)
    if len(begun) > BEGUN_MAX_SHARE * len(poses) + 1:
        raise text.error(
            int(scans.lines[begun[0]]),
            f"here and {len(begun) - 1} times more odometry does not go on; it must be in metres and radians",
        )
    delay_s = 0.0 if len(begun) else range_delay_s(times_s, poses, ranges_m, np.array(scans.bearings_rad))
    if delay_s:
        notes.append(
            f"the ranges are {delay_s:.2f} s older than the odometry beside them; each was put to that of its time"
        )
        poses = poses_at(times_s, poses, delay_s)
        poses[:, 2] = wrap_angles(poses[:, 2])
    sentences = tuple(f"{text.path}, {note}." for note in notes)
    centre_m = scans.laser.as_array()[:2]
    return RangeLog(times_s, poses, ranges_m, scans.bearings_rad, scans.lines, goes_on, centre_m, sentences)


def _check_ranges(text: LogText, scans: Scans) -> None:
    echoes_m = scans.ranges_m[np.isfinite(scans.ranges_m)]
    line = int(scans.lines[0])
    if not len(echoes_m):
        raise text.error(line, "from here on no range is an echo: all are 0, empty or at their limit in metres")
    if float(np.median(echoes_m)) > RANGE_USUAL_MAX_M:
        raise text.error(
            line, f"from here on ranges are about {float(np.median(echoes_m)):.4g} long; they must be in metres"
        )


def _silence(ranges_m: FloatArray, notes: list[str]) -> None:
    """A sensor without an echo may report its longest range, which recurs as none a little shorter does."""
    while np.isfinite(ranges_m).any():
        longest_m = float(np.nanmax(ranges_m))
        longest = ranges_m == longest_m
        below = ranges_m[(ranges_m < longest_m) & (ranges_m > longest_m - SILENT_BELOW_M)]
        often = int(np.unique(below, return_counts=True)[1].max(initial=0))
        echo_count = int(np.isfinite(ranges_m).sum())
        beams = int((longest.sum(axis=0) >= SILENT_MIN / SILENT_TIMES).sum())
        recurs = longest.sum() >= max(SILENT_MIN, SILENT_SHARE * echo_count, SILENT_TIMES * often)
        if not recurs or beams < min(2, ranges_m.shape[1]):
            return
        notes.append(f"ranges of {longest_m:g} m, {int(longest.sum())} of {echo_count}, were taken for no echo")
        ranges_m[longest] = np.nan


def _steps_m(poses: FloatArray) -> FloatArray:
    step = np.diff(poses[:, :2], axis=0)
    return np.hypot(step[:, 0], step[:, 1])


def _usual_step_m(poses: FloatArray) -> float:
    steps_m = _steps_m(poses)
    steps_m = steps_m[steps_m > MOVED_M]
    return float(np.median(steps_m)) if len(steps_m) else 0.0
