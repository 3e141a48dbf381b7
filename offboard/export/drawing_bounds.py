"""Where a drawing of the map begins and how large it is; the page and all exports count from the same base point."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, floor
from typing import Any

import numpy as np
import numpy.typing as npt

MARGIN_M = 2.0  # room for the number of a door in an outer wall
FOOT_M = 2.2  # room for the scale bar under the map


def drawing_bounds(places_m: Iterable[npt.NDArray[np.floating[Any]]]) -> tuple[float, float, float, float]:
    """Base point x and y (lower left corner, in the map), width and height: whole metres around all places (N, 2)."""
    there = [np.zeros((1, 2)), *filter(len, places_m)]
    low = np.min([places.min(axis=0) for places in there], axis=0) - (MARGIN_M, FOOT_M)
    high = np.max([places.max(axis=0) for places in there], axis=0) + MARGIN_M
    x0_m, y0_m = floor(low[0]), floor(low[1])
    return x0_m, y0_m, max(ceil(high[0]) - x0_m, 8), ceil(high[1]) - y0_m
