"""Straight wall pieces: lines through the echoes of a few metres of driving, and which of them are one wall.

A hall's wall goes on where it was: a piece that continues an earlier one carries its direction and offset on, and with
them the heading, over tens of metres. (Line landmarks for sparse sensing: Zhou et al., IROS 2022.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, radians

import numpy as np

from common.geometry import FloatArray, Points, Pose2, wrap_angle

PIECE_POINTS_MIN = 25
PIECE_LENGTH_MIN_M = 1.5
PIECE_SD_MAX_M = 0.03
INLIER_M = 0.06
BEND_MAX_RAD = radians(4.0)  # a piece round a slight corner has no direction
SAME_ANGLE_RAD = radians(5.0)
SAME_OFFSET_M = 0.30
GAP_MAX_M = 6.0


@dataclass(slots=True)
class WallPiece:
    """A straight piece of wall, in the frame of key frame `node`: its middle, its normal (away from the robot).

    `upright`: does the wall stand at right angles to the others? None as long as nobody asked.
    """

    node: int
    way_m: float
    x_m: float
    y_m: float
    normal_rad: float
    length_m: float
    upright: bool | None = None

    def in_map(self, pose: Pose2) -> tuple[FloatArray, float]:
        """Middle (2,) and normal (radians) in the map, given the pose of its key frame."""
        return pose.transform([self.x_m, self.y_m]), wrap_angle(self.normal_rad + pose.heading_rad)


@dataclass(frozen=True, slots=True)
class WallAhead:
    """A wall seen straight ahead from `x_m`, `y_m`, with that normal, in the frame of key frame `node`."""

    node: int
    way_m: float
    x_m: float
    y_m: float
    normal_rad: float
    range_m: float


def fit_piece(points: Points, normals_rad: FloatArray) -> tuple[FloatArray, float, float] | None:
    """Middle (2,), normal (radians) and length of the line through most of `points` (N, 2), or None."""
    if len(points) < PIECE_POINTS_MIN:
        return None
    mean = atan2(float(np.sin(normals_rad).mean()), float(np.cos(normals_rad).mean()))
    offset = points @ np.array([np.cos(mean), np.sin(mean)])
    keep = np.abs(offset - np.median(offset)) < 3 * INLIER_M
    normal_rad = mean
    for _ in range(3):
        if keep.sum() < PIECE_POINTS_MIN:
            return None
        middle = points[keep].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((points[keep] - middle).T))
        normal = vectors[:, 0] * (1.0 if vectors[:, 0] @ [np.cos(mean), np.sin(mean)] > 0 else -1.0)
        residual = (points - middle) @ normal
        keep = np.abs(residual) < INLIER_M
        normal_rad = atan2(float(normal[1]), float(normal[0]))
    if keep.mean() <= 0.7:
        return None
    along, off = (points[keep] - middle) @ np.array([-normal[1], normal[0]]), residual[keep]
    length_m = float(np.ptp(along))
    if length_m < PIECE_LENGTH_MIN_M or off.std() >= PIECE_SD_MAX_M or abs(_bend_rad(along, off)) > BEND_MAX_RAD:
        return None
    return middle, normal_rad, length_m


def _bend_rad(along: FloatArray, off: FloatArray) -> float:
    """By how much the direction changes from end to end: a parabola through the residuals (N,) of the line."""
    square = along**2 - (along**2).mean()
    return 2 * float(np.ptp(along)) * float((square * off).sum()) / max(float((square**2).sum()), 1e-9)


def continuation(
    middle: FloatArray,
    normal_rad: float,
    length_m: float,
    other_middle: FloatArray,
    other_normal: float,
    other_m: float,
) -> tuple[float, float] | None:
    """Angle and offset by which a piece departs from the line of another one, or None where they are no one wall."""
    turn = wrap_angle(normal_rad - other_normal)
    if abs(turn) > SAME_ANGLE_RAD:
        return None
    n = np.array([np.cos(other_normal), np.sin(other_normal)])
    gap = middle - other_middle
    offset = float(gap @ n)
    along = abs(float(gap @ np.array([-n[1], n[0]])))
    if abs(offset) > SAME_OFFSET_M or along - (length_m + other_m) / 2 > GAP_MAX_M:
        return None
    return turn, offset
