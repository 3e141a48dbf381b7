"""Map increments -> the whole map: what MMU has sent so far, in its own numbering, with holes where some were lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from common.messages.mapping import MapUpdate

_SPARE = 1.25  # of the room for points, so that an increment need not copy all before it


class MapAssembly:
    """Wall points by index. A point that never came is NaN until MMU begins the map anew.

    MMU begins anew, at 0, with every revision. Where that beginning was lost the older points stand in for it: a map
    that is a little off serves better than none. Arrays that were given out stay as they are.
    """

    def __init__(self) -> None:
        self.missing = 0  # points that were lost in transit, of the map as it is now
        self._revision = -1
        self._length = self._holes = 0
        self._points_m: npt.NDArray[np.float32] = np.empty((0, 2), np.float32)
        self._inferred: npt.NDArray[np.uint8] = np.empty(0, np.uint8)

    def __len__(self) -> int:
        return self._length

    def add(self, update: MapUpdate) -> int:
        """Take an increment; returns how many points before it were lost."""
        gap = max(update.start - self._length, 0)
        lost = gap if update.revision == self._revision else update.start
        self.missing = 0 if update.start == 0 else self.missing + lost
        self._revision = update.revision
        if update.start < self._length:
            self._cut(update.start)
        self._append(np.full((gap, 2), np.nan, np.float32), np.zeros(gap, np.uint8))
        self._append(update.points_m, update.inferred)
        self._holes += gap
        return lost

    def pack(self) -> list[object]:
        """For `unpack`."""
        points_m, inferred = self._points_m[: self._length], self._inferred[: self._length]
        return [self.missing, self._revision, points_m.tobytes(), inferred.tobytes()]

    @classmethod
    def unpack(cls, packed: Sequence[Any]) -> MapAssembly:
        assembly = cls()
        assembly.missing, assembly._revision, points_m, inferred = packed
        assembly._points_m = np.frombuffer(points_m, np.float32).reshape(-1, 2).copy()  # to be appended to
        assembly._inferred = np.frombuffer(inferred, np.uint8).copy()
        assembly._length = len(assembly._inferred)
        assembly._holes = assembly._count_holes()
        return assembly

    def known(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
        """The points that came (N, 2) and their marks (N,)."""
        points_m, inferred = self._points_m[: self._length], self._inferred[: self._length]
        if not self._holes:
            return points_m, inferred
        came = ~np.isnan(points_m[:, 0])
        return points_m[came], inferred[came]

    def _cut(self, length: int) -> None:
        """What comes next is written elsewhere than what was given out."""
        self._points_m, self._inferred = self._points_m[:length].copy(), self._inferred[:length].copy()
        self._length = length
        self._holes = self._count_holes() if self._holes else 0

    def _count_holes(self) -> int:
        return int(np.count_nonzero(np.isnan(self._points_m[: self._length, 0])))

    def _append(self, points_m: npt.NDArray[np.float32], inferred: npt.NDArray[np.uint8]) -> None:
        end = self._length + len(points_m)
        if end > len(self._points_m):
            room = int(_SPARE * end)
            self._points_m, before_m = np.empty((room, 2), np.float32), self._points_m
            self._inferred, before = np.empty(room, np.uint8), self._inferred
            self._points_m[: self._length], self._inferred[: self._length] = (
                before_m[: self._length],
                before[: self._length],
            )
        self._points_m[self._length : end], self._inferred[self._length : end] = points_m, inferred
        self._length = end
