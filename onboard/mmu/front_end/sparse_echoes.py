"""Echoes of frames that lie far apart: where walls lie, by the ranges of all beams of a few neighbouring frames.

A run of ranges of one beam (`beam_track`) shows a wall only where frames follow each other closely. Half a metre apart,
few ranges of one beam meet one wall, but the beams together do: a range's place lies on a line with places that the
neighbouring frames measured, whatever beam met them there.

Every line through a place and one near it is tried; the one that most other places lie on is the wall.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import atan2, cos, pi

import numpy as np

from common.geometry import FloatArray, Points, Pose2, principal_axis, wrap_angle
from onboard.mmu.front_end.beam_track import Echo

FRAMES = 5  # that are looked at together; echoes are those of the middle one
REACH_MIN_M = 0.6  # how far from a place others may lie on the same wall
REACH_SPACINGS = 1.2  # likewise, in spacings of frames: those of the same beam before and after
STEP_SPACINGS = 0.4  # a frame closer to the one before shows nothing new, unless the robot turned
STEP_RAD = 0.2
OFF_LINE_M = 0.04
OFF_LINE_SHARE = 0.01  # of the range
APART_MIN_M = 0.08  # two places closer than this show no direction
PLACES_MIN = 3
GRAZING_COS = 0.3  # a wall met more obliquely than this is not believed
TURN_MAX_RAD = 1.2  # a robot that turns more between frames: they are not looked at together


@dataclass(frozen=True, slots=True)
class _Frame:
    t_s: float
    pose: Pose2
    ranges_m: FloatArray
    places: Points  # (beams, 2) in odom, NaN for no echo


class SparseEchoes:
    """`add` takes a frame and gives the echoes of the one that lies in the middle of the newest few."""

    def __init__(self, bearings_rad: tuple[float, ...], spacing_m: float) -> None:
        self._bearings_rad = np.array(bearings_rad)
        self._reach_m = max(REACH_MIN_M, REACH_SPACINGS * spacing_m)
        self._step_m = STEP_SPACINGS * spacing_m
        self._frames: deque[_Frame] = deque(maxlen=FRAMES)

    def add(self, t_s: float, pose: Pose2, ranges_m: FloatArray) -> list[Echo]:
        """`ranges_m` (beams,), NaN or infinite for no echo."""
        if self._frames and not self._moved(self._frames[-1].pose, pose):
            return []
        ranges_m = np.where(np.isfinite(ranges_m) & (ranges_m > 0), ranges_m, np.nan)
        direction_rad = pose.heading_rad + self._bearings_rad
        away = ranges_m[:, None] * np.stack([np.cos(direction_rad), np.sin(direction_rad)], axis=1)
        self._frames.append(_Frame(t_s, pose, ranges_m, np.array([pose.x_m, pose.y_m]) + away))
        return self._echoes_of(len(self._frames) // 2) if len(self._frames) == FRAMES else []

    def _moved(self, last: Pose2, pose: Pose2) -> bool:
        turned_rad = abs(wrap_angle(pose.heading_rad - last.heading_rad))
        return last.distance_m(pose) >= self._step_m or turned_rad >= STEP_RAD

    def _echoes_of(self, middle: int) -> list[Echo]:
        frame = self._frames[middle]
        around = [
            other.places
            for other in self._frames
            if abs(wrap_angle(other.pose.heading_rad - frame.pose.heading_rad)) < TURN_MAX_RAD
        ]
        places = np.concatenate(around)
        places = places[np.isfinite(places[:, 0])]
        echoes = []
        for place, range_m in zip(frame.places, frame.ranges_m.tolist(), strict=True):
            near = places[np.hypot(*(places - place).T) <= self._reach_m] if np.isfinite(range_m) else places[:0]
            away = place - [frame.pose.x_m, frame.pose.y_m]
            normal_rad = _normal_rad(place, near, away, OFF_LINE_M + OFF_LINE_SHARE * range_m)
            if normal_rad is not None:
                echoes.append(Echo(frame.t_s, float(place[0]), float(place[1]), normal_rad, range_m, OFF_LINE_M))
        return echoes


def _normal_rad(place: FloatArray, near: Points, away: FloatArray, off_max_m: float) -> float | None:
    """Of the wall through `place` (2,) and most of the places `near` it (N, 2), itself among them; None where none."""
    to = near - place
    apart_m = np.hypot(to[:, 0], to[:, 1])
    far = apart_m > APART_MIN_M
    if len(near) < PLACES_MIN or not far.any():
        return None
    along = to[far] / apart_m[far, None]
    off_m = np.abs(along[:, :1] * to[:, 1] - along[:, 1:] * to[:, 0])  # (lines, places)
    on = off_m <= off_max_m
    votes = on.sum(axis=1) - 0.5 * (off_m * on).sum(axis=1) / on.sum(axis=1) / off_max_m
    best = int(votes.argmax())
    if on[best].sum() < PLACES_MIN:
        return None
    along_rad, _, _ = principal_axis(near[on[best]])
    normal_rad = along_rad + pi / 2
    cosine = cos(normal_rad - atan2(away[1], away[0]))
    if abs(cosine) < GRAZING_COS:
        return None
    return wrap_angle(normal_rad if cosine > 0 else normal_rad - pi)
