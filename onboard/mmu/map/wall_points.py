"""The wall points of the map as they are published: echoes where they lie, and the points inferred between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.geometry import Points
from onboard.mmu.map.growing_rows import GrowingRows


@dataclass(frozen=True, slots=True)
class WallPoints:
    """Places in the map (N, 2), and marks (N,): 1 where a wall was inferred, not echoed."""

    points_m: npt.NDArray[np.float32]
    inferred: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, echoed: Points, inferred: Points) -> WallPoints:
        """Echoes (N, 2), then what was inferred from them (M, 2)."""
        points = np.concatenate([echoed, inferred]).astype(np.float32)
        return cls(points, np.repeat(np.array([0, 1], np.uint8), [len(echoed), len(inferred)]))


class WallStore:
    """All of them in the order in which they are published."""

    def __init__(self) -> None:
        self._points_m, self._inferred = GrowingRows(np.float32, (2,), 1024), GrowingRows(np.uint8, (), 1024)

    def __len__(self) -> int:
        return len(self._points_m)

    def replace(self, walls: WallPoints) -> None:
        """These in place of all that were kept."""
        self._points_m.replace(walls.points_m)
        self._inferred.replace(walls.inferred)

    def append(self, walls: WallPoints) -> None:
        self._points_m.append(walls.points_m)
        self._inferred.append(walls.inferred)

    def since(self, start: int) -> WallPoints:
        """From the `start`-th on, a copy."""
        return WallPoints(self._points_m.rows[start:].copy(), self._inferred.rows[start:].copy())
