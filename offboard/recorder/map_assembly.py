"""Map increments -> the whole map: what MMU has sent so far, in its own numbering, with holes where some were lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from common.messages import MapUpdate


class MapAssembly:
    """Wall points by index. A point that never came is NaN until MMU begins the map anew.

    MMU begins anew, at 0, with every revision. Where that beginning was lost the older points stand in for it: a map
    that is a little off serves better than none.
    """

    def __init__(self) -> None:
        self.missing = 0  # points that were lost on the way, of the map as it is now
        self._revision = -1
        self._points_m: npt.NDArray[np.float32] = np.empty((0, 2), np.float32)
        self._inferred: npt.NDArray[np.uint8] = np.empty(0, np.uint8)

    def __len__(self) -> int:
        return len(self._points_m)

    def add(self, update: MapUpdate) -> int:
        """Take an increment; returns how many points before it were lost."""
        gap = max(update.start - len(self), 0)
        lost = gap if update.revision == self._revision else update.start
        self.missing = 0 if update.start == 0 else self.missing + lost
        self._revision = update.revision
        hole = np.full((gap, 2), np.nan, np.float32)
        self._points_m = np.concatenate([self._points_m[: update.start], hole, update.points_m])
        unmarked = np.zeros(gap, np.uint8)
        self._inferred = np.concatenate([self._inferred[: update.start], unmarked, update.inferred])
        return lost

    def pack(self) -> list[object]:
        """For `unpack`."""
        return [self.missing, self._revision, self._points_m.tobytes(), self._inferred.tobytes()]

    @classmethod
    def unpack(cls, packed: Sequence[Any]) -> MapAssembly:
        assembly = cls()
        assembly.missing, assembly._revision, points_m, inferred = packed
        assembly._points_m = np.frombuffer(points_m, np.float32).reshape(-1, 2)
        assembly._inferred = np.frombuffer(inferred, np.uint8)
        return assembly

    def known(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
        """The points that came (N, 2) and their marks (N,)."""
        came = np.isfinite(self._points_m).all(axis=1)
        return self._points_m[came], self._inferred[came]
