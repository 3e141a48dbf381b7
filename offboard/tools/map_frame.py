"""Where a drawing of the map begins and how large it is; the page and all exports count from the same base point."""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from offboard.recorder.run_folder import MapData

MARGIN_M = 2.0  # room for the number of a door in an outer wall
FOOT_M = 2.2  # room for the scale bar under the map


def frame(data: MapData) -> tuple[float, float, float, float]:
    """Base point x and y (lower left corner, in the map), width and height: whole metres around all there is."""
    pois = np.array([[poi["x_m"], poi["y_m"]] for poi in data.pois], dtype=np.float64).reshape(-1, 2)
    everything = np.concatenate([data.points_m, data.trajectory[:, :2], pois, np.zeros((1, 2))])
    low = everything.min(axis=0) - (MARGIN_M, FOOT_M)
    high = everything.max(axis=0) + MARGIN_M
    x0_m, y0_m = floor(low[0]), floor(low[1])
    return x0_m, y0_m, max(ceil(high[0]) - x0_m, 8), ceil(high[1]) - y0_m
