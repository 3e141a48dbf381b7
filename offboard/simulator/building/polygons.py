"""Plane geometry of rings and wall segments, for the checks of `floor.py` and the changes by `events.py`.

A ring is an (N, 2) array of corners in metres, closed implicitly. Segments are (N, 4) rows x0, y0, x1, y1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points

_SAME_POINT_M = 1e-6


def normalised_ring(corners: Points, counter_clockwise: bool) -> Points:
    """The ring without repeated neighbours (nor a repeated first corner), in the wanted sense of rotation."""
    kept: list[tuple[float, float]] = []
    for x_m, y_m in corners.tolist():
        if not kept or max(abs(x_m - kept[-1][0]), abs(y_m - kept[-1][1])) > _SAME_POINT_M:
            kept.append((x_m, y_m))
    if len(kept) > 1 and max(abs(kept[0][0] - kept[-1][0]), abs(kept[0][1] - kept[-1][1])) <= _SAME_POINT_M:
        kept.pop()
    ring = np.array(kept, dtype=np.float64).reshape(-1, 2)
    return ring if (signed_area_m2(ring) > 0) == counter_clockwise else ring[::-1].copy()


def signed_area_m2(ring: Points) -> float:
    """Positive for a counter-clockwise ring (the shoelace formula)."""
    x_m, y_m = ring[:, 0], ring[:, 1]
    return float(0.5 * (x_m @ np.roll(y_m, -1) - np.roll(x_m, -1) @ y_m))


def ring_segments(ring: Points) -> FloatArray:
    """(N, 4) edges of a ring, in its order."""
    return np.hstack([ring, np.roll(ring, -1, axis=0)])


def crossings(first: FloatArray, second: FloatArray) -> list[tuple[int, int]]:
    """Indices of the pairs of segments that cross inside both of them, or run over one another."""

    def side(a: FloatArray, b: FloatArray) -> FloatArray:
        """(len(a), len(b), 2): on which side of segment a the two ends of b lie, in metres."""
        direction = a[:, 2:] - a[:, :2]
        direction = direction / np.maximum(np.hypot(direction[:, 0], direction[:, 1]), _SAME_POINT_M)[:, None]
        ends = b.reshape(1, -1, 2, 2) - a[:, None, None, :2]
        return np.asarray(direction[:, None, None, 0] * ends[..., 1] - direction[:, None, None, 1] * ends[..., 0])

    one, two = side(first, second), side(second, first).transpose(1, 0, 2)
    tolerance_m = _SAME_POINT_M
    proper = (one.min(2) < -tolerance_m) & (one.max(2) > tolerance_m)
    proper &= (two.min(2) < -tolerance_m) & (two.max(2) > tolerance_m)
    collinear = (np.abs(one).max(2) < tolerance_m) & (_overlap_m(first, second) > tolerance_m)
    return [(int(i), int(j)) for i, j in np.argwhere(proper | collinear)]


def _overlap_m(first: FloatArray, second: FloatArray) -> FloatArray:
    """(len(first), len(second)): how long the segments of the second overlap those of the first along its direction."""
    direction = first[:, 2:] - first[:, :2]
    length_m = np.hypot(direction[:, 0], direction[:, 1])
    unit = direction / np.maximum(length_m, _SAME_POINT_M)[:, None]
    along = ((second.reshape(1, -1, 2, 2) - first[:, None, None, :2]) * unit[:, None, None, :]).sum(-1)
    return np.asarray(np.minimum(along.max(2), length_m[:, None]) - np.maximum(along.min(2), 0.0))


def contains(ring: Points, points: Points) -> npt.NDArray[np.bool_]:
    """Which of the points (N, 2) lie inside the ring (even-odd rule)."""
    a, b = ring[None], np.roll(ring, -1, axis=0)[None]
    x_m, y_m = points[:, None, 0], points[:, None, 1]
    spans = (a[..., 1] > y_m) != (b[..., 1] > y_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing_x_m = a[..., 0] + (y_m - a[..., 1]) * (b[..., 0] - a[..., 0]) / (b[..., 1] - a[..., 1])
    inside: npt.NDArray[np.bool_] = (spans & (x_m < crossing_x_m)).sum(1) % 2 == 1
    return inside


def distances_m(segments: FloatArray, x_m: float | FloatArray, y_m: float | FloatArray) -> FloatArray:
    """(N,) distance of a point to each segment; (P, N) of P points, whose coordinates are (P, 1)."""
    dx, dy = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    px, py = x_m - segments[:, 0], y_m - segments[:, 1]
    along = np.clip((px * dx + py * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(px - along * dx, py - along * dy))
