"""Walls as landmarks: straight pieces are lines through the echoes of a few metres; several of them make one wall.

The wall of a hall continues where it was: a piece that continues an earlier one carries its direction on, and with it
the heading, over tens of metres. (Line landmarks for sparse sensing: Zhou et al., IROS 2022.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, radians, sin

import numpy as np

from common.geometry import FloatArray, Points, Pose2, wrap_angle

# Tuned with the noise of sonars; the sensitivity was not measured
PIECE_POINTS_MIN = 25
PIECE_LENGTH_MIN_M = 1.5
PIECE_SD_MAX_M = 0.03
INLIER_M = 0.06
BOW_MAX_RAD = radians(4.0)  # a piece around a slight corner has no direction
SAME_OFFSET_M = 0.30
GAP_MAX_M = 6.0


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece of wall in the map: its middle (2,), its normal (away from the robot), its length."""

    middle: FloatArray
    normal_rad: float
    length_m: float

    def continues(self, other: Line, wall_rad: float, same_rad: float) -> bool:
        """May both be of one wall, whose normal is `wall_rad`? `same_rad`: by how much this one's may differ."""
        if abs(wrap_angle(self.normal_rad - wall_rad)) > same_rad:
            return False
        n = np.array([cos(wall_rad), sin(wall_rad)])
        gap = self.middle - other.middle
        apart_m = abs(float(gap @ [-n[1], n[0]])) - (self.length_m + other.length_m) / 2
        return abs(float(gap @ n)) <= SAME_OFFSET_M and apart_m <= GAP_MAX_M


@dataclass(slots=True)
class WallLandmark:
    """A straight wall. `node`: keyframe of its newest piece; `length_m`: of all its pieces, which overlap."""

    node: int
    length_m: float = 0.0
    orthogonal: bool | None = None  # does it stand at right angles to the others? None as long as that is not known


@dataclass(frozen=True, slots=True)
class WallPiece:
    """A straight piece of wall, in the frame of keyframe `node`: its middle, its normal (away from the robot)."""

    node: int
    path_m: float
    x_m: float
    y_m: float
    normal_rad: float
    length_m: float

    @classmethod
    def of(cls, line: Line, node: int, pose: Pose2, path_m: float) -> WallPiece:
        """Relative to a keyframe with that pose."""
        x_m, y_m = pose.inverse().transform(line.middle).tolist()
        return cls(node, path_m, x_m, y_m, wrap_angle(line.normal_rad - pose.heading_rad), line.length_m)

    def in_map(self, pose: Pose2) -> Line:
        """Given the pose of its keyframe."""
        normal_rad = wrap_angle(self.normal_rad + pose.heading_rad)
        return Line(pose.transform([self.x_m, self.y_m]), normal_rad, self.length_m)


@dataclass(frozen=True, slots=True)
class WallAhead:
    """A wall observed straight ahead from `x_m`, `y_m`, with that normal, in the frame of keyframe `node`."""

    node: int
    path_m: float
    x_m: float
    y_m: float
    normal_rad: float
    range_m: float


def fit_piece(points: Points, normals_rad: FloatArray) -> Line | None:
    """The line through most of `points` (N, 2), whose echoes came along `normals_rad` (N,), or None."""
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
    if length_m < PIECE_LENGTH_MIN_M or off.std() >= PIECE_SD_MAX_M or abs(_bow_rad(along, off)) > BOW_MAX_RAD:
        return None
    return Line(middle, normal_rad, length_m)


def _bow_rad(along: FloatArray, off: FloatArray) -> float:
    """By how much the direction changes from end to end: a parabola through the residuals (N,) of the line."""
    square = along**2 - (along**2).mean()
    return 2 * float(np.ptp(along)) * float((square * off).sum()) / max(float((square**2).sum()), 1e-9)
