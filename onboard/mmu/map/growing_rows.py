"""Rows that grow in number: one array, enlarged by a quarter at a time, so that a row costs no object of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


class GrowingRows:
    """`rows` (N, *shape) of one dtype, a view of what is kept: who writes to it changes it."""

    def __init__(self, dtype: npt.DTypeLike = np.float64, shape: tuple[int, ...] = (), capacity: int = 256) -> None:
        self._kept: npt.NDArray[Any] = np.zeros((capacity, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> npt.NDArray[Any]:
        return self._kept[: self._count]

    def append(self, rows: npt.ArrayLike) -> None:
        """(K, *shape) more."""
        more = np.asarray(rows, self._kept.dtype)
        needed = self._count + len(more)
        if needed > len(self._kept):
            grown = max(needed, len(self._kept) * 5 // 4) - len(self._kept)
            self._kept = np.concatenate([self._kept, np.zeros((grown, *self._kept.shape[1:]), self._kept.dtype)])
        self._kept[self._count : needed] = more
        self._count = needed

    def replace(self, rows: npt.ArrayLike) -> None:
        """These instead of all that were kept."""
        self._count = 0
        self.append(rows)
