"""Range logs of the robot navigation toolkit CARMEN -> `Scans`: lines FLASER, ROBOTLASER1 and ROBOTLASER2.

Each such line holds a sweep of a laser, the laser's pose and the robot's odometry; of the sweep only a few beams are
kept. What a FLASER line lacks stands in the log's PARAM lines: how far the laser sees, over which angle, and
where it sits on the robot.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import degrees, inf, nan, pi, radians

import numpy as np

from common.geometry import FloatArray, Pose2, wrap_angle, wrap_angles
from offboard.replay.log_scans import CENTRE, LogText, RangeLogError, ReadOptions, Scans, nearest, shown

RANGE_MAX_M = 50.0  # of any laser indoors: lasers write 80 m and more for no echo
KINDS = ("FLASER", "ROBOTLASER1", "ROBOTLASER2")
OTHERS = ("PARAM", "ODOM", "RLASER", "LASER3", "LASER4", "TRUEPOS", "SYNC", *(f"RAWLASER{i}" for i in range(1, 6)))

_SPREAD = np.array([1.0, 0.5, 0.0, -0.5, -1.0])  # which beams of a sweep, where none are requested
_SPREAD_RAD = pi / 2
_BEAM_OFF_MAX_RAD = radians(2.0)
_TURN_RAD = 2 * pi + 0.01
_HALF_TURN_COUNTS = (180, 181, 360, 361)
_MOUNTING_SAME = 0.02  # metres and radians, from line to line
_MOUNTING_MAX_M = 2.0
_POSE_COLUMNS = 8


def line_kinds(lines: list[str]) -> Counter[str]:
    """How many lines begin with each of CARMEN's words."""
    words = (line.split(None, 1)[0] for line in lines if line and not line.isspace())
    return Counter(word for word in words if word in KINDS or word in OTHERS)


def read_carmen(text: LogText, kinds: Counter[str], options: ReadOptions) -> Scans:
    """One laser: the kind of line that the log has most of. Raises RangeLogError."""
    name = max(KINDS, key=lambda kind: kinds[kind])
    if not kinds[name]:
        found = ", ".join(sorted(kinds))
        raise RangeLogError(
            f"{text.path} is a CARMEN log without lines FLASER or ROBOTLASER1, which hold ranges and odometry; "
            f"its lines are {found}."
        )
    notes: list[str] = []
    reader = _Reader(text, options, _parameters(text))
    numbers = [n for n, line in enumerate(text.lines, 1) if line.split(None, 1)[:1] == [name]]
    lines, rows = text.rows(numbers, _POSE_COLUMNS, reader.poses, notes)
    laser = reader.mounting(name, rows[:, 2:5], rows[:, 5:8]) if len(rows) else CENTRE
    beams_rad = reader.choose(int(lines[0]), laser.heading_rad) if len(rows) else np.zeros(0)
    if name == "FLASER" and len(lines):
        reader.note_sweep(int(lines[0]), notes)
    lines, ranges_m = text.rows(lines.tolist(), len(beams_rad), lambda n: reader.ranges(n, beams_rad), notes)
    bearings_rad = tuple(wrap_angle(b + laser.heading_rad) for b in beams_rad.tolist())
    rows = rows[: len(lines)]
    return Scans(lines, _stamps(rows), rows[:, 2:5], ranges_m, bearings_rad, laser, notes)


def _parameters(text: LogText) -> dict[str, tuple[int, str]]:
    """Line and value of each; the last word counts."""
    parameters = {}
    for number, line in enumerate(text.lines, 1):
        words = line.split(None, 3)
        if len(words) > 2 and words[0] == "PARAM":
            parameters[words[1]] = (number, words[2])
    return parameters


def _stamps(rows: FloatArray) -> FloatArray:
    """Of the two clocks of a line, the message's and the logger's, the one that runs; equal ones where neither is."""
    column = max((0, 1), key=lambda k: len(np.unique(rows[:, k])))
    stamps: FloatArray = rows[:, column]
    return np.zeros(len(rows)) if np.isnan(stamps).any() else stamps


@dataclass(frozen=True, slots=True)
class _Scan:
    """A line, in words; its angles are the laser's own, left positive."""

    first_rad: float
    step_rad: float
    limit_m: float
    ranges: list[str]
    laser: list[str]
    odometry: list[str]
    stamps: list[str]

    @property
    def bearings_rad(self) -> FloatArray:
        return self.first_rad + self.step_rad * np.arange(len(self.ranges), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Reader:
    text: LogText
    options: ReadOptions
    parameters: dict[str, tuple[int, str]]
    _after: dict[str, int] = field(default_factory=dict)  # how many words follow the ranges in the first line
    _indices: dict[tuple[float, float, int], list[int]] = field(default_factory=dict)

    def poses(self, number: int) -> list[float]:
        """Message's and logger's stamp, odometry, pose of the laser."""
        scan = self._scan(number)
        stamps = [self.text.number(number, word) for word in scan.stamps] or [nan]
        numbers = [self.text.number(number, word) for word in (*scan.odometry, *scan.laser)]
        return [stamps[0], stamps[-1], *numbers]

    def ranges(self, number: int, beams_rad: FloatArray) -> list[float]:
        """Those of the beams (B,), NaN for no echo."""
        scan = self._scan(number)
        sweep = (scan.first_rad, scan.step_rad, len(scan.ranges))
        if sweep not in self._indices:
            self._indices[sweep] = self._look_up(number, scan, beams_rad)
        ranges_m = [self.text.any_number(number, scan.ranges[i]) for i in self._indices[sweep]]
        return [r if 0 < r < scan.limit_m else nan for r in ranges_m]

    def choose(self, number: int, turned_rad: float) -> FloatArray:
        """Bearings (B,), as the laser has them, of the beams requested on the robot, or of a few spread ones."""
        scan = self._scan(number)
        bearings_rad, step_rad = scan.bearings_rad, abs(scan.step_rad)
        if self.options.beams_deg is not None:
            wanted_rad = np.radians(self.options.beams_deg) - turned_rad
            return bearings_rad[self._look_up(number, scan, wanted_rad, _BEAM_OFF_MAX_RAD)]
        middle_rad = (bearings_rad[0] + bearings_rad[-1]) / 2
        middle_rad = 0.0 if abs(middle_rad) <= step_rad else middle_rad
        half_rad = min(_SPREAD_RAD, (len(scan.ranges) + 1) * step_rad / 2)
        picked = self._look_up(number, scan, middle_rad + half_rad * _SPREAD, inf)
        return bearings_rad[list(dict.fromkeys(picked))]

    def note_sweep(self, number: int, notes: list[str]) -> None:
        """Notes the field of view that a FLASER is taken to have, unless it is half a turn with a usual count."""
        scan = self._scan(number)
        over_rad = -2 * scan.first_rad
        if len(scan.ranges) not in _HALF_TURN_COUNTS or over_rad != pi:
            notes.append(
                f"line {number}: the {len(scan.ranges)} readings of a sweep were taken to cover "
                f"{degrees(over_rad):.0f} degrees; --field-of-view sets another"
            )

    def mounting(self, name: str, robot: FloatArray, laser: FloatArray) -> Pose2:
        """Where the laser sits on the robot: its pose (N, 3) as seen from the robot's, if that is always the same."""
        poses = zip(map(Pose2.from_array, robot), map(Pose2.from_array, laser), strict=True)
        seen = np.array([of_robot.between(of_laser).as_array() for of_robot, of_laser in poses])
        middle = np.array([*np.median(seen[:, :2], axis=0), seen[len(seen) // 2, 2]])
        off = np.abs(seen - middle)
        off[:, 2] = np.abs(wrap_angles(seen[:, 2] - middle[2]))
        same = np.percentile(off, 95) < _MOUNTING_SAME and np.hypot(*middle[:2]) < _MOUNTING_MAX_M and laser.any()
        if same and np.abs(middle).max() >= _MOUNTING_SAME / 2:
            return Pose2.from_array(middle)
        if name != "FLASER":
            return CENTRE
        offsets = [self._parameter(f"robot_frontlaser_{which}offset") or 0.0 for which in ("", "side_", "angular_")]
        return Pose2(offsets[0], offsets[1], wrap_angle(_angle_rad(offsets[2])))

    def _look_up(self, number: int, scan: _Scan, beams_rad: FloatArray, off_max_rad: float | None = None) -> list[int]:
        """Which readings of a scan are those of the beams (B,)."""
        off_max_rad = max(_BEAM_OFF_MAX_RAD, 0.51 * abs(scan.step_rad)) if off_max_rad is None else off_max_rad
        picked = []
        for beam_rad in beams_rad.tolist():
            index, off_rad = nearest(scan.bearings_rad, beam_rad)
            if off_rad > off_max_rad:
                raise self.text.error(number, f"the laser does not look at {degrees(beam_rad):g} degrees")
            picked.append(index)
        return picked

    def _scan(self, number: int) -> _Scan:
        words = self.text.lines[number - 1].split()
        return self._flaser(number, words) if words[0] == "FLASER" else self._robotlaser(number, words)

    def _flaser(self, number: int, words: list[str]) -> _Scan:
        """FLASER count ranges... laser's x y heading, odometry's x y heading, stamp, host, logger's stamp"""
        count = self._count(number, words, 1)
        tail = words[2 + count :]
        usual = self._after.setdefault(words[0], max(len(tail), 3))
        if len(tail) < usual:
            raise self.text.error(number, f"{len(tail)} words follow the ranges, where there must be {usual}")
        stamps = [*tail[6:7], *tail[8:9]]
        intervals = max(count - count % 2, 1)  # an even number of readings leaves the last one out
        over_rad = self._field_of_view_rad(intervals)
        limit_m = self._parameter("robot_front_laser_max") or inf
        odometry = tail[3:6] if len(tail) >= 6 else tail[:3]
        limit_m = min(limit_m, RANGE_MAX_M)
        return _Scan(-over_rad / 2, over_rad / intervals, limit_m, words[2 : 2 + count], tail[:3], odometry, stamps)

    def _robotlaser(self, number: int, words: list[str]) -> _Scan:
        """ROBOTLASER1 type first field_of_view step range_max accuracy remission_mode count ranges... [count
        remissions...] laser's x y heading, odometry's x y heading, five more, stamp, host, logger's stamp"""
        count = self._count(number, words, 8)
        remissions = len(words) - (9 + count) - 14
        if remissions < 0:
            raise self.text.error(number, f"{14 + remissions} words follow the ranges, where poses and stamps need 14")
        first_rad, step_rad, limit_m = (self.text.number(number, words[i]) for i in (2, 4, 5))
        if step_rad == 0.0 and count > 1:
            raise self.text.error(number, "the angle between its beams is 0, so that they have no bearings")
        if abs(step_rad) * (count - 1) > _TURN_RAD or abs(first_rad) > _TURN_RAD:
            raise self.text.error(number, "its beams reach over more than a turn; angles must be in radians")
        limit_m = min(limit_m if limit_m > 0 else inf, RANGE_MAX_M)
        tail = words[-14:]
        return _Scan(first_rad, step_rad, limit_m, words[9 : 9 + count], tail[:3], tail[3:6], [tail[11], tail[13]])

    def _count(self, number: int, words: list[str], at: int) -> int:
        """How many ranges follow."""
        declared, left = shown(words[at]) if at < len(words) else "no", len(words) - at - 1
        count = self.text.number(number, words[at]) if at < len(words) else 0.0
        if not count.is_integer() or count < 1:
            raise self.text.error(number, f"{declared} readings; delete lines that hold none")
        if count > left:
            raise self.text.error(number, f"{declared} readings are named, {left} values follow")
        return int(count)

    def _field_of_view_rad(self, intervals: int) -> float:
        """Over which angle a FLASER looks: as it is declared, or half a turn."""
        if self.options.field_of_view_deg is not None:
            return radians(self.options.field_of_view_deg)
        declared = self._parameter("laser_front_laser_fov")
        step = self._parameter("laser_front_laser_resolution")
        over = declared if declared is not None else step * intervals if step is not None else pi
        over_rad = _angle_rad(over)
        if not 0.0 < over_rad <= _TURN_RAD:
            raise RangeLogError(
                f"{self.text.path}: by its PARAM lines the laser looks over {over:g}; --field-of-view sets the degrees."
            )
        return over_rad

    def _parameter(self, name: str) -> float | None:
        return self.text.number(*self.parameters[name]) if name in self.parameters else None


def _angle_rad(value: float) -> float:
    """Parameters hold degrees or radians: more than a turn's worth of radians are degrees."""
    return value if abs(value) <= _TURN_RAD else radians(value)
