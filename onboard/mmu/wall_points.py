"""The wall points of the map as they go out: echoes where they lie, and what was concluded between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry import Points


@dataclass(frozen=True, slots=True)
class WallPoints:
    """Places in the map (N, 2), and marks (N,): 1 where a wall was concluded, not echoed."""

    points_m: npt.NDArray[np.float32]
    inferred: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, echoed: Points, concluded: Points) -> WallPoints:
        """Echoes (N, 2), then what was concluded from them (M, 2)."""
        points = np.concatenate([echoed, concluded]).astype(np.float32)
        return cls(points, np.repeat(np.array([0, 1], np.uint8), [len(echoed), len(concluded)]))


class WallStore:
    """All of them in the order in which they go out; grows by doubling."""

    def __init__(self) -> None:
        self.begin_anew(WallPoints.of(np.zeros((0, 2)), np.zeros((0, 2))))

    def begin_anew(self, walls: WallPoints) -> None:
        """In place of all that was."""
        self._points_m, self._inferred = walls.points_m, walls.inferred
        self.count = len(walls.points_m)

    def append(self, walls: WallPoints) -> None:
        end = self.count + len(walls.points_m)
        if end > len(self._points_m):
            room = max(end, 1024)
            self._points_m = np.concatenate([self._points_m[: self.count], np.zeros((room, 2), np.float32)])
            self._inferred = np.concatenate([self._inferred[: self.count], np.zeros(room, np.uint8)])
        self._points_m[self.count : end] = walls.points_m
        self._inferred[self.count : end] = walls.inferred
        self.count = end

    def since(self, start: int) -> WallPoints:
        """From the `start`-th on, a copy."""
        rows = slice(start, self.count)
        return WallPoints(self._points_m[rows].copy(), self._inferred[rows].copy())
