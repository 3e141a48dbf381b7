"""The border of zones as the collision monitor meets it: an echo ahead, where no sonar hears anything. Pure.

The grid's cells keep a path away from it. This is for what the grid is too old or too coarse for: the sides
themselves, against the footprint where the robot is now.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, isnan, sin

import numpy as np
import numpy.typing as npt

from common.constants import FOOTPRINT_RADIUS_M, SONAR_FRONT
from common.geometry import FloatArray, Points, Pose2
from common.zones import Zone, ZoneKind, keeps_out, sides_of

RADIUS_M = FOOTPRINT_RADIUS_M + 0.03
LOOKED_M = 2.0  # ahead: further than it takes to stop
_RAYS = np.linspace(-RADIUS_M, RADIUS_M, 11)  # along the way that the hull goes, from its right to its left
_FRONT = np.sqrt(np.maximum(RADIUS_M**2 - _RAYS**2, 0.0))
_BESIDE_M = 0.01  # before and behind a side
_AROUND = _BESIDE_M * np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class ZoneGuard:
    """Of some zones."""

    def __init__(self, zones: Sequence[Zone] = ()) -> None:
        self.zones = tuple(zones)
        self._sides = sides_of(zones)
        self._is_line = np.array([zone.kind is ZoneKind.LINE for zone in zones for _ in zone.sides], bool)
        self._stands_out = np.column_stack([self._is_line | self._borders(self._sides[:, k : k + 2]) for k in (0, 2)])

    def room_m(self, pose: Pose2, heading_rad: float) -> float:
        """How far the hull can go along a heading before it touches a border (metres); infinite where there is none
        near. A border that it would leave a zone by does not count."""
        if not len(self._sides):
            return inf
        c, s = cos(heading_rad), sin(heading_rad)
        along, aside = self._seen_from(pose, c, s)
        ray, side, ahead_m = self._crossings(along, aside)
        at = np.column_stack([pose.x_m + ahead_m * c - _RAYS[ray] * s, pose.y_m + ahead_m * s + _RAYS[ray] * c])
        enters = self._is_line[side] | self._enters(at, np.array([c, s]))
        room_m = [ahead_m[enters] - _FRONT[ray[enters]], self._to_corners_m(pose, along, aside)]
        return float(np.concatenate(room_m).min(initial=inf))

    def _seen_from(self, pose: Pose2, c: float, s: float) -> tuple[FloatArray, FloatArray]:
        """How far ahead and to the left both ends of each side lie, (E, 2) each."""
        x, y = self._sides[:, 0::2] - pose.x_m, self._sides[:, 1::2] - pose.y_m
        return x * c + y * s, y * c - x * s

    def _crossings(self, along: FloatArray, aside: FloatArray) -> tuple[Indices, Indices, FloatArray]:
        """Of the hull's rays with the sides: number of the ray, of the side, and how far ahead."""
        width = aside[:, 1] - aside[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (_RAYS[:, None] - aside[:, 0]) / width
            ahead_m = along[:, 0] + share * (along[:, 1] - along[:, 0])
        hit = (width != 0.0) & (share >= 0.0) & (share <= 1.0) & (ahead_m >= 0.0) & (ahead_m < LOOKED_M)
        ray, side = np.nonzero(hit)
        return ray, side, ahead_m[ray, side]

    def _enters(self, at: Points, way: FloatArray) -> Mask:
        """Is the robot kept out behind these points (N, 2), and not before?"""
        behind, before = keeps_out(self.zones, at + _BESIDE_M * way), keeps_out(self.zones, at - _BESIDE_M * way)
        return np.asarray(behind & ~before)

    def _borders(self, at: Points) -> Mask:
        """Is the robot kept out anywhere right beside these points (N, 2)? Not at a corner inside another area."""
        beside = (at[:, None] + _AROUND).reshape(-1, 2)
        return np.asarray(keeps_out(self.zones, beside).reshape(len(at), len(_AROUND)).any(axis=1))

    def _to_corners_m(self, pose: Pose2, along: FloatArray, aside: FloatArray) -> FloatArray:
        """How far it can go before it touches corners that lie between two rays."""
        if bool(keeps_out(self.zones, np.array([[pose.x_m, pose.y_m]]))[0]):
            return np.empty(0)
        met: Mask = self._stands_out & (np.abs(aside) < RADIUS_M) & (along >= 0.0) & (along < LOOKED_M)
        room_m: FloatArray = along[met] - np.sqrt(RADIUS_M**2 - aside[met] ** 2)
        return room_m


def with_border(ranges_m: tuple[float, ...], room_m: float) -> tuple[float, ...]:
    """The five ranges, the one to the front no longer than to a border so far ahead of the hull."""
    if room_m == inf:
        return ranges_m
    front_m, border_m = ranges_m[SONAR_FRONT], FOOTPRINT_RADIUS_M + room_m
    nearest_m = border_m if isnan(front_m) else min(front_m, border_m)
    return (*ranges_m[:SONAR_FRONT], nearest_m, *ranges_m[SONAR_FRONT + 1 :])
