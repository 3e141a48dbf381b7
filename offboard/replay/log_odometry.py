"""Odometry of a log, from whatever wheels -> poses that go on as wheels can, and where they do not.

1. Headings in degrees give themselves away: robots drive where they look.
2. A few poses out of reach, before odometry goes on, lie evenly between their neighbours.
3. Odometry that does not go on after that began anew: the robot is taken to have driven on as just before, unless its
   beams see what they saw where odometry now claims to be, and not what they saw a moment ago. How the part before lies
   to the part after is not known then; whoever maps must find out.

Odometry that goes on is kept to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Pose2, wrap_angle, wrap_angles
from offboard.replay.log_scans import Lines, note

REACH_M, REACH_M_S = 1.0, 3.0  # what no robot indoors goes beyond from scan to scan
REACH_RAD, REACH_RAD_S = 1.5, 2.0
PAUSE_MAX_S = 60.0  # a longer one allows no further path
HOME = 0.05  # metres and radians: a driver that was started again begins at zero
USUAL_TIMES = 3.0  # so many times the usual step is no step to zero
GLITCH_MAX = 5  # scans
SAME_PLACE = 0.3  # metres and radians together
BEAMS_SAME_MIN = 2
SAME_VIEW_M, OTHER_VIEW_M = 0.1, 0.3
VIEWS = 10  # how many scans must see what was seen there
BACK_MAX_M = 100.0  # how far from where it was a robot is believed to be elsewhere all of a sudden
COURSE_OFF = 0.05  # mean square of the sine between heading and course of a robot that does not drive where it looks
COURSE_TIMES = 5.0

NEAR_ZERO_M = 1e5  # further off, places lose digits
BEGUN = (
    "odometry does not go on from the scan before; a new piece of the map begins, to be connected to the rest by what "
    "it sees"
)

Mask = npt.NDArray[np.bool_]


def in_radians(poses: FloatArray, notes: list[str]) -> FloatArray:
    """Poses (N, 3) whose headings are radians."""
    off = _off_course(poses)
    if off > COURSE_OFF:
        turned = np.column_stack([poses[:, :2], np.radians(poses[:, 2])])
        if _off_course(turned) < off / COURSE_TIMES:
            notes.append("the headings were taken for degrees: that is how the robot drives where it looks")
            return turned
    return poses


def _off_course(poses: FloatArray) -> float:
    step = np.diff(poses[:, :2], axis=0)
    moved_m = np.hypot(step[:, 0], step[:, 1])
    turn_rad = wrap_angles(np.diff(poses[:, 2]))
    off_rad = np.arctan2(step[:, 1], step[:, 0]) - poses[:-1, 2] - turn_rad / 2
    weight = np.minimum(moved_m, REACH_M)
    return float((weight * np.sin(off_rad) ** 2).sum() / max(weight.sum(), 1e-9))


@dataclass(slots=True)
class Trust:
    """Odometry `poses` (N, 3) at `times_s` (N,), `ranges_m` (N, beams) measured there, and the scans' `lines` (N,)."""

    times_s: FloatArray
    poses: FloatArray
    ranges_m: FloatArray
    lines: Lines
    notes: list[str]
    _usual: tuple[float, float] = field(init=False)
    _reached: Mask = field(init=False)  # (N,) from the scan before

    def __post_init__(self) -> None:
        step_m = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        turn_rad = np.abs(wrap_angles(np.diff(self.poses[:, 2])))
        moves = (step_m > 0) | (turn_rad > 0)
        usual = [float(np.percentile(v[moves], 95)) if moves.any() else 0.0 for v in (step_m, turn_rad)]
        self._usual = max(usual[0], HOME), max(usual[1], HOME)
        dt_s = np.minimum(np.diff(self.times_s), PAUSE_MAX_S)
        reached = (step_m <= REACH_M + REACH_M_S * dt_s) & (turn_rad <= REACH_RAD + REACH_RAD_S * dt_s)
        far = (step_m > USUAL_TIMES * self._usual[0]) | (turn_rad > USUAL_TIMES * self._usual[1])
        reached &= ~(far & (np.abs(self.poses[1:]) < HOME).all(axis=1))
        self._reached = np.append(True, reached)

    def judge(self) -> tuple[FloatArray, Mask]:
        """Poses (N, 3) that go on, and for which scans (N,) that is known; adds notes."""
        raw, begun = self._without_strays()
        note(self.notes, self.lines[begun].tolist(), BEGUN)
        poses, goes_on = raw.copy(), np.ones(len(raw), np.bool_)
        for at in begun:
            goes_on[at] = False
            start = self._begin(at, raw, poses)
            turn = Pose2(start.x_m, start.y_m, wrap_angle(start.heading_rad - float(raw[at, 2])))
            poses[at:, :2] = turn.transform(raw[at:, :2] - raw[at, :2])
            poses[at:, 2] = wrap_angles(raw[at:, 2] + turn.heading_rad)
        if np.abs(poses[:, :2]).max() > NEAR_ZERO_M:
            poses[:, :2] -= poses[0, :2].copy()
        return poses, goes_on

    def _without_strays(self) -> tuple[FloatArray, list[int]]:
        """Poses (N, 3) without those out of reach for a few scans, and with which scans odometry began anew."""
        raw, strays = self.poses.copy(), np.zeros(len(self.poses), np.bool_)
        begun: list[int] = []
        back = 0
        for at in np.flatnonzero(~self._reached).tolist():
            if at <= back:
                continue
            back = self._back(at)
            if back:
                raw[at:back] = _between(raw[at - 1], raw[back], back - at)
                strays[at:back] = True
            elif at <= GLITCH_MAX and not begun:  # it was not ready at first
                raw[:at] = raw[at]
                strays[:at] = True
            else:
                begun.append(at)
        note(self.notes, self.lines[strays].tolist(), "odometry is out of reach there; it was put to its neighbours")
        return raw, begun

    def _back(self, at: int) -> int:
        """Where soon after `at` odometry jumps back to where it goes on from the scan before; 0 where it does not."""
        for k in range(at + 1, min(at + 1 + GLITCH_MAX, len(self.poses))):
            before, after = Pose2.from_array(self.poses[at - 1]), Pose2.from_array(self.poses[k])
            dt_s = min(float(self.times_s[k] - self.times_s[at - 1]), PAUSE_MAX_S)
            if not self._reached[k] and before.distance_m(after) <= REACH_M + REACH_M_S * dt_s:
                return k
        return 0

    def _begin(self, at: int, raw: FloatArray, poses: FloatArray) -> Pose2:
        """Where the robot most likely is in scan `at`, whose odometry began anew."""
        before = Pose2.from_array(poses[at - 1])
        place = self._place_again(at, raw)
        if place is not None:
            claimed = Pose2.from_array(raw[place]).between(Pose2.from_array(raw[at]))
            back = Pose2.from_array(poses[place]).compose(claimed)
            if before.distance_m(back) < BACK_MAX_M:
                return back
        if at < 2:
            return before
        step = Pose2.from_array(poses[at - 2]).between(before)
        dt_s = np.diff(self.times_s[at - 2 : at + 1])
        share = min(1.0, float(dt_s[1] / dt_s[0]))
        return before.compose(Pose2(share * step.x_m, share * step.y_m, share * step.heading_rad))

    def _place_again(self, at: int, raw: FloatArray) -> int | None:
        """The scan before `at` that saw what is seen now, where odometry now claims to be; None where none did."""
        views = range(at, min(at + VIEWS, len(raw)))
        places = []
        for scan in views:
            off = np.hypot(*(raw[:at, :2] - raw[scan, :2]).T) + np.abs(wrap_angles(raw[:at, 2] - raw[scan, 2]))
            places.append(int(off.argmin()))
            if off.min() > SAME_PLACE:
                return None
        if np.array_equal(self.ranges_m[views], self.ranges_m[places], equal_nan=True):
            return places[0]  # the very same recording
        off_m = np.median([self._view_off_m(*pair) for pair in zip(views, places, strict=True)])
        moved = self._view_off_m(at, at - 1) > OTHER_VIEW_M
        return places[0] if moved and off_m < SAME_VIEW_M else None

    def _view_off_m(self, a: int, b: int) -> float:
        """By how much the ranges of two scans differ; infinite where too few beams have an echo in both."""
        off_m = np.abs(self.ranges_m[a] - self.ranges_m[b])
        off_m = off_m[np.isfinite(off_m)]
        return float(np.median(off_m)) if len(off_m) >= BEAMS_SAME_MIN else np.inf


def _between(first: FloatArray, last: FloatArray, count: int) -> FloatArray:
    """Poses (count, 3) evenly between two (3,)."""
    path = last - first
    path[2] = wrap_angle(float(path[2]))
    return first + path * (np.arange(1, count + 1) / (count + 1))[:, None]
