"""Range logs in the shared CSV format -> `Scans`.

Comment lines `# bearings_deg: ...` and `# max_range_m: ...`; a header with `t_s`, `odom_x_m`, `odom_y_m`,
`odom_heading_rad` and `range0_m` on, in any order; then one line per scan, an empty cell where there was no echo.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import degrees, inf, isnan, nan, pi, radians

import numpy as np

from common.geometry import FloatArray
from offboard.replay.log_scans import CENTRE, LogText, RangeLogError, ReadOptions, Scans, nearest, shown

POSE_COLUMNS = ("t_s", "odom_x_m", "odom_y_m", "odom_heading_rad")
BEARINGS, LIMITS = "bearings_deg", "max_range_m"
_SEPARATORS = ("\t", ";", ",")
_BEAM_OFF_MAX_RAD = radians(2.0)
_TURN = 2 * pi + 0.01


def read_csv(text: LogText, options: ReadOptions) -> Scans:
    """Raises RangeLogError."""
    notes: list[str] = []
    comments = _comments(text)
    if BEARINGS not in comments:
        raise RangeLogError(
            f"{text.path} is no CARMEN log, and a CSV log needs a comment line '# {BEARINGS}: ...' with the "
            f"directions of its beams."
        )
    bearings_rad = _bearings(text, *comments[BEARINGS], notes)
    limits_m = _limits(text, comments, len(bearings_rad))
    table = _Table.of(text, len(bearings_rad))
    lines, rows = text.rows(table.numbers, len(table.order), table.row, notes)
    ranges_m = rows[:, 4:]
    ranges_m[~((ranges_m > 0) & (ranges_m < limits_m))] = nan
    keep = _pick(text.path, bearings_rad, options.beams_deg)
    return Scans(lines, rows[:, 0], rows[:, 1:4], ranges_m[:, keep], tuple(bearings_rad[keep].tolist()), CENTRE, notes)


def _comments(text: LogText) -> dict[str, tuple[int, str]]:
    """Line and value of every comment that is named."""
    comments: dict[str, tuple[int, str]] = {}
    for number, line in enumerate(text.lines, 1):
        key, colon, value = line.lstrip()[1:].partition(":") if line.lstrip().startswith("#") else ("", "", "")
        key, value = key.strip().lower(), value.strip()
        if key in (BEARINGS, LIMITS) and comments.get(key, (number, value))[1] != value:
            raise text.error(number, f"another {key} than in line {comments[key][0]}; make two logs of it")
        if colon:
            comments.setdefault(key, (number, value))
    return comments


def _values(text: LogText, line: int, value: str) -> list[float]:
    words = value.split(";") if ";" in value else re.split(r"[,\s]+", value)
    try:
        values = [float(word.replace(",", ".")) for word in words]
    except ValueError:
        raise text.error(line, f"must be numbers with commas between, not '{shown(value)}'") from None
    if any(map(isnan, values)):
        raise text.error(line, "must be numbers, not nan")
    return values


def _bearings(text: LogText, line: int, value: str, notes: list[str]) -> FloatArray:
    bearings = np.array(_values(text, line, value))
    if not np.isfinite(bearings).all():
        raise text.error(line, "a beam must look somewhere, not at inf")
    if len(bearings) > 1 and np.abs(bearings).max() <= _TURN:
        notes.append(f"line {line}: all {len(bearings)} bearings lie within 6.3, so they were taken for radians")
        return bearings
    bearings_rad: FloatArray = np.radians(bearings)
    return bearings_rad


def _limits(text: LogText, comments: dict[str, tuple[int, str]], beams: int) -> FloatArray:
    if LIMITS not in comments:
        return np.full(beams, inf)
    line = comments[LIMITS][0]
    limits = _values(text, *comments[LIMITS])
    if len(limits) != beams:
        raise text.error(line, f"{LIMITS} names {len(limits)} beams, {BEARINGS} {beams}")
    if min(limits) <= 0:
        raise text.error(line, f"{LIMITS} must be above 0")
    return np.array(limits)


@dataclass(frozen=True, slots=True)
class _Table:
    """Lines with scans, and which cell of them holds what: `order` (4 + beams)."""

    text: LogText
    numbers: list[int]
    separator: str
    order: list[int]
    columns: int

    @classmethod
    def of(cls, text: LogText, beams: int) -> _Table:
        numbers = [n for n, line in enumerate(text.lines, 1) if line.strip() and not line.lstrip().startswith("#")]
        if not numbers:
            raise RangeLogError(f"{text.path} holds no header and no scans.")
        at, line = numbers[0], text.lines[numbers[0] - 1]
        separator = next((s for s in _SEPARATORS if s in line), ",")
        names = [name.lower() for name in _cells(line, separator)]
        expected = [*POSE_COLUMNS, *(f"range{i}_m" for i in range(beams))]
        for i, name in enumerate(expected):
            if name not in names:
                found = shown(names[i]) if i < len(names) else "nothing"
                raise text.error(at, f"column {i + 1} must be {name}, not {found}")
        for name in names:
            if name and (name not in expected or names.count(name) > 1):
                reason = "stands there twice" if name in expected else "has no bearing"
                raise text.error(at, f"column {shown(name)} {reason}")
        numbers = [n for n in numbers if text.lines[n - 1] != line]
        return cls(text, numbers, separator, [names.index(name) for name in expected], len(names))

    def row(self, number: int) -> list[float]:
        cells = _cells(self.text.lines[number - 1], self.separator)
        if len(cells) < self.columns or any(cells[self.columns :]):
            raise self.text.error(number, f"{len(cells)} columns where the header has {self.columns}")
        pose, ranges = [cells[i] for i in self.order[:4]], [cells[i] for i in self.order[4:]]
        if not all(pose):
            raise self.text.error(number, "time and odometry must not be empty")
        return [
            *(self.text.number(number, cell) for cell in pose),
            *(self.text.any_number(number, cell) if cell else nan for cell in ranges),
        ]


def _cells(line: str, separator: str) -> list[str]:
    cells = [cell.strip().strip('"').strip() for cell in line.split(separator)]
    return cells if separator == "," else [cell.replace(",", ".") for cell in cells]


def _pick(path: str, bearings_rad: FloatArray, wanted_deg: tuple[float, ...] | None) -> list[int]:
    if wanted_deg is None:
        return list(range(len(bearings_rad)))
    picked = []
    for beam_deg in wanted_deg:
        index, off_rad = nearest(bearings_rad, radians(beam_deg))
        if off_rad > _BEAM_OFF_MAX_RAD:
            beams = ", ".join(f"{degrees(b):g}" for b in bearings_rad)
            raise RangeLogError(f"{path} has no beam at {beam_deg:g} degrees; its beams: {beams}.")
        picked.append(index)
    return picked
