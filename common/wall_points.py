"""The wall points of the map, put together from what the mapping unit sends."""

from __future__ import annotations

import numpy as np

from common.geometry import Points
from common.messages import MapUpdate


def with_increment(points: Points, update: MapUpdate) -> Points:
    """The points (N, 2) with an increment; one that does not continue them is left out until the map begins anew."""
    if update.start not in (0, len(points)):
        return points
    return np.concatenate([points[: update.start], update.points_m.astype(np.float64)])
