"""What the mission sees in one tick, and the motion that it wants of the Carrier."""

from __future__ import annotations

from dataclasses import dataclass

from common.geometry import Points, Pose2
from common.messages import Speed
from onboard.planner.grid.grid_map import GridMap

FRONT_STOP_M = 0.5  # from the ring's centre: straight driving ends here


@dataclass(frozen=True, slots=True)
class View:
    """`points` (N, 2) of walls near the robot, distances from the ring's centre (NaN = no echo).

    `grid_revision` grows with every new grid.
    """

    now_s: float
    pose: Pose2
    grid: GridMap
    grid_revision: int
    points: Points
    left_m: float
    right_m: float
    front_m: float

    @property
    def front_is_near(self) -> bool:
        """So near that straight driving ends."""
        return self.front_m < FRONT_STOP_M


@dataclass(frozen=True, slots=True)
class Motion:
    """A speed and a heading in the map."""

    speed: Speed
    heading_rad: float
