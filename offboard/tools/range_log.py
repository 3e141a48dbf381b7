"""Range logs of any carrier: the shared CSV format and CARMEN logs -> `RangeLog`.

CSV: comment lines `# bearings_deg: ...` and `# max_range_m: ...`, a header `t_s,odom_x_m,odom_y_m,odom_heading_rad,
range0_m,...`, then one line per frame, an empty cell where there was no echo. CARMEN: `FLASER` and `ROBOTLASER1` lines
with the odometry they carry; of their laser only the beams asked for are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import degrees, inf, isfinite, nan, radians
from pathlib import Path

import numpy as np

from common.errors import StartError
from common.geometry import FloatArray

_POSE_COLUMNS = ("t_s", "odom_x_m", "odom_y_m", "odom_heading_rad")
_DEFAULT_BEAMS_DEG = (90.0, 45.0, 0.0, -45.0, -90.0)
_CARMEN_RANGE_MAX_M = 50.0
_BEAM_OFF_MAX_RAD = radians(2.0)


class RangeLogError(StartError):
    """The log cannot be used: one sentence with file, line and what is wrong."""


@dataclass(frozen=True, slots=True)
class RangeLog:
    """`times_s` (N,), odometry `poses` (N, 3), `ranges_m` (N, beams) with NaN for no echo, `bearings_rad` (beams,)."""

    times_s: FloatArray
    poses: FloatArray
    ranges_m: FloatArray
    bearings_rad: tuple[float, ...]

    @property
    def range_step_m(self) -> float:
        """The step that the ranges are rounded to; 0 when they are not."""
        heard = np.unique(np.round(self.ranges_m[np.isfinite(self.ranges_m)], 5))
        gaps = np.diff(heard)
        return float(gaps.min()) if len(gaps) and gaps.min() >= 0.005 else 0.0


def read_range_log(path: Path, beams_deg: tuple[float, ...] | None = None) -> RangeLog:
    """The log in a file; `beams_deg` picks beams (of a CSV: among its own). Raises RangeLogError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise RangeLogError(f"The log {path} cannot be read: {reason}.") from error
    carmen = any(line.startswith(("FLASER ", "ROBOTLASER1 ")) for line in lines[:2000])
    log = _carmen(path, lines, beams_deg or _DEFAULT_BEAMS_DEG) if carmen else _csv(path, lines, beams_deg)
    if len(log.times_s) < 2:
        raise RangeLogError(f"{path} holds no frames.")
    return log


def _csv(path: Path, lines: list[str], beams_deg: tuple[float, ...] | None) -> RangeLog:
    comments = {}
    at = 0
    while at < len(lines) and lines[at].startswith("#"):
        key, _, value = lines[at][1:].partition(":")
        comments[key.strip()] = (at + 1, value)
        at += 1
    if "bearings_deg" not in comments:
        raise RangeLogError(f"{path}: no comment line '# bearings_deg: ...' before the header.")
    bearings = _comment(path, *comments["bearings_deg"])
    limits = _comment(path, *comments["max_range_m"]) if "max_range_m" in comments else (inf,) * len(bearings)
    if len(limits) != len(bearings):
        line = comments["max_range_m"][0]
        raise RangeLogError(
            f"{path}, line {line}: max_range_m names {len(limits)} beams, bearings_deg {len(bearings)}."
        )
    expected = [*_POSE_COLUMNS, *(f"range{i}_m" for i in range(len(bearings)))]
    header = [name.strip() for name in lines[at].split(",")] if at < len(lines) else []
    for i, name in enumerate(expected):
        if i >= len(header) or header[i] != name:
            found = header[i] if i < len(header) else "nothing"
            raise RangeLogError(f"{path}, line {at + 1}: column {i + 1} must be {name}, not {found}.")
    if len(header) > len(expected):
        raise RangeLogError(f"{path}, line {at + 1}: column {header[len(expected)]} has no bearing.")
    rows = np.array(list(_csv_rows(path, lines, at + 1, len(expected)))).reshape(-1, len(expected))
    ranges = rows[:, 4:]
    ranges[(ranges <= 0) | (ranges > np.array(limits))] = nan
    keep = _pick(path, bearings, beams_deg)
    return RangeLog(rows[:, 0], rows[:, 1:4], ranges[:, keep], tuple(radians(bearings[i]) for i in keep))


def _comment(path: Path, line: int, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(v) for v in text.split(","))
    except ValueError as error:
        raise RangeLogError(f"{path}, line {line}: must be numbers with commas between.") from error


def _csv_rows(path: Path, lines: list[str], start: int, columns: int) -> Iterator[list[float]]:
    for number, line in enumerate(lines[start:], start + 1):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) != columns:
            raise RangeLogError(f"{path}, line {number}: {len(cells)} columns where the header has {columns}.")
        try:
            row = [float(c) if c.strip() else nan for c in cells]
        except ValueError as error:
            raise RangeLogError(f"{path}, line {number}: {error}.") from error
        if not all(map(isfinite, row[:4])):
            raise RangeLogError(f"{path}, line {number}: time and odometry must not be empty.")
        yield row


def _pick(path: Path, bearings_deg: tuple[float, ...], asked: tuple[float, ...] | None) -> list[int]:
    if asked is None:
        return list(range(len(bearings_deg)))
    picked = []
    for beam in asked:
        nearest = min(range(len(bearings_deg)), key=lambda i: abs(bearings_deg[i] - beam))
        if abs(bearings_deg[nearest] - beam) > degrees(_BEAM_OFF_MAX_RAD):
            beams = ", ".join(f"{b:g}" for b in bearings_deg)
            raise RangeLogError(f"{path} has no beam at {beam:g} degrees; its beams: {beams}.")
        picked.append(nearest)
    return picked


def _carmen(path: Path, lines: list[str], beams_deg: tuple[float, ...]) -> RangeLog:
    """One laser: the kind of line that the log has more of."""
    kind: Callable[[list[str]], list[float]]
    flaser = sum(line.startswith("FLASER ") for line in lines) >= sum(line.startswith("ROBOTLASER1 ") for line in lines)
    name, kind = ("FLASER ", _flaser) if flaser else ("ROBOTLASER1 ", _robotlaser)
    bearings = [radians(b) for b in beams_deg]
    rows = []
    for number, line in enumerate(lines, 1):
        if not line.startswith(name):
            continue
        try:
            time_s, x_m, y_m, heading_rad, first_rad, step_rad, *laser = kind(line.split())
            picked = [_beam(laser, first_rad, step_rad, b) for b in bearings]
        except (ValueError, IndexError) as error:
            raise RangeLogError(f"{path}, line {number}: no complete {name.strip()} line ({error}).") from error
        rows.append([time_s, x_m, y_m, heading_rad, *picked])
    table = np.array(rows).reshape(-1, 4 + len(bearings))
    return RangeLog(table[:, 0], table[:, 1:4], table[:, 4:], tuple(bearings))


def _flaser(words: list[str]) -> list[float]:
    """FLASER count ranges... x y theta odom_x odom_y odom_theta ipc_time host logger_time"""
    count = int(words[1])
    laser = [float(w) for w in words[2 : 2 + count]]
    tail = words[2 + count :]
    step_rad = np.pi / count if count % 2 == 0 else np.pi / (count - 1)
    odometry = [float(w) for w in tail[3:6]]
    return [float(tail[6]), *odometry, -np.pi / 2, step_rad, *laser]


def _robotlaser(words: list[str]) -> list[float]:
    """ROBOTLASER1 type start fov step range_max accuracy remission count ranges... rems... laser pose robot pose ..."""
    first_rad, step_rad, range_max_m = float(words[2]), float(words[4]), float(words[5])
    count = int(words[8])
    laser = [float(w) for w in words[9 : 9 + count]]
    laser = [r if r < range_max_m else nan for r in laser]
    remissions = int(words[9 + count])
    tail = words[10 + count + remissions :]
    robot = [float(w) for w in tail[3:6]]
    return [float(tail[11]), *robot, first_rad, step_rad, *laser]


def _beam(laser: list[float], first_rad: float, step_rad: float, bearing_rad: float) -> float:
    index = min(max(round((bearing_rad - first_rad) / step_rad), 0), len(laser) - 1)
    if abs(first_rad + index * step_rad - bearing_rad) > _BEAM_OFF_MAX_RAD:
        raise ValueError(f"the laser does not look at {degrees(bearing_rad):g} degrees")
    range_m = laser[index]
    return range_m if 0 < range_m < _CARMEN_RANGE_MAX_M else nan
