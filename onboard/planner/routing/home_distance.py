"""How far is it home? A query, answered beside the steps."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isfinite

from common.geometry import Pose2
from onboard.planner.grid.deliberation import Grids
from onboard.planner.routing.route_planning import cell_prices
from onboard.planner.routing.walking_distances import WalkingDistances

UNKNOWN_FACTOR = 3.0  # of the straight line, where no path is known


@dataclass(frozen=True, slots=True)
class HomeDistance:
    """On the grid of that revision, from a pose; the answer in metres."""

    revision: int
    pose: Pose2

    def answer(self, grids: Grids) -> float:
        grid, pose = grids.of(self.revision), self.pose
        here = grid.cell(pose.x_m, pose.y_m)
        (distance_m,) = WalkingDistances(cell_prices(grid, here), grid.cell_m).of(here, [grid.cell(0.0, 0.0)]).tolist()
        return distance_m if isfinite(distance_m) else UNKNOWN_FACTOR * hypot(pose.x_m, pose.y_m)
