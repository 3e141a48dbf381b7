"""Results that are found again while what they depend on stays the same: most of a floor is as it was a second ago."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b

import numpy as np
import numpy.typing as npt


class RecentResults:
    """Numbers by the arrays that they were computed from. What was not asked for between two calls of `turn` goes."""

    def __init__(self) -> None:
        self._before: dict[bytes, float] = {}
        self._now: dict[bytes, float] = {}

    def turn(self) -> None:
        """A new round of questions begins."""
        self._before, self._now = self._now, {}

    def of(self, compute: Callable[..., float], *arrays: npt.NDArray[np.generic]) -> float:
        """`compute(*arrays)`, or what that returned before."""
        digest = blake2b(digest_size=16)
        for array in arrays:
            digest.update(repr((array.shape, array.dtype.str)).encode())
            digest.update(np.ascontiguousarray(array).data)
        key = digest.digest()
        known = self._now.get(key, self._before.get(key))
        self._now[key] = compute(*arrays) if known is None else known
        return self._now[key]
