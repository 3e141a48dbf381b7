"""What the mission sees in one tick, and the motion that it wants of the Carrier."""

from __future__ import annotations

from dataclasses import dataclass

from common.geometry import Points, Pose2
from common.messages.motion import Speed
from common.wall_points import WallPointMap
from onboard.planner.grid.grid_map import GridMap

POINTS_NEAR_M = 4.0
BEND_FRONT_M, BEND_SIDE_M = 0.9, 3.5
FRONT_STOP_M = 0.5  # from the ring's centre: straight driving ends here


@dataclass(frozen=True, slots=True)
class View:
    """Distances from the ring's centre (NaN = no echo). `grid_revision` grows with every new grid."""

    now_s: float
    pose: Pose2
    grid: GridMap
    grid_revision: int
    walls: WallPointMap
    left_m: float
    right_m: float
    front_m: float

    @property
    def points(self) -> Points:
        """Of walls near the robot (N, 2)."""
        return self.walls.near(self.pose.x_m, self.pose.y_m, POINTS_NEAR_M)

    @property
    def hall_bends(self) -> bool:
        """A wall ahead, about as far off as the middle of the hall that goes on along it, and no wall on one side."""
        open_aside = any(not side_m < BEND_SIDE_M for side_m in (self.left_m, self.right_m))  # NaN: no echo
        return self.front_m < BEND_FRONT_M and open_aside

    @property
    def front_is_near(self) -> bool:
        """So near that straight driving ends."""
        return self.front_m < FRONT_STOP_M


@dataclass(frozen=True, slots=True)
class Motion:
    """A speed and a heading in the map."""

    speed: Speed
    heading_rad: float
