"""What the mapping unit publishes: pose, map points, occupancy grid, corrected trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, sin

from common.fields import (
    GRID_CELLS_MAX,
    CellSize,
    Count,
    GridBytes,
    GridSide,
    MapPoints,
    MapStart,
    Marks,
    Metres,
    Poses,
    Radians,
    Seconds,
    Spread,
    Times,
)
from common.geometry import Pose2


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Where the robot is in the map (frame: its start pose), with its uncertainty, tied to SIM's yaw at that moment."""

    t_s: Seconds
    x_m: Metres
    y_m: Metres
    heading_rad: Radians
    yaw_rad: Radians  # SIM's yaw at t_s: heading_rad - yaw_rad turns a map heading into a drive command
    sd_xy_m: Spread  # in the worst direction
    sd_heading_rad: Spread
    map_revision: Count
    valid: bool = True
    sd_least_m: Spread = inf  # at right angles to the worst direction, which is `worst_rad` on the map
    worst_rad: Radians = 0.0

    @property
    def covariance(self) -> tuple[float, float, float]:
        """Of the position on the map: xx, xy, yy (m²)."""
        worst, least = self.sd_xy_m**2, min(self.sd_least_m, self.sd_xy_m) ** 2
        c, s = cos(self.worst_rad), sin(self.worst_rad)
        return c * c * worst + s * s * least, c * s * (worst - least), s * s * worst + c * c * least

    @property
    def pose(self) -> Pose2:
        return Pose2(self.x_m, self.y_m, self.heading_rad)


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """Wall points. `start` 0 begins the map anew (the past was corrected); else the points go on at index `start`."""

    t_s: Seconds
    revision: Count
    start: MapStart
    points_m: MapPoints
    inferred: Marks  # 1 where a wall was concluded, not echoed
    valid: bool = True


@dataclass(frozen=True, slots=True)
class GridUpdate:
    """The occupancy grid for driving: 0 unknown, 1 free, 2 wall; zlib over the row-major cells."""

    t_s: Seconds
    revision: Count
    origin_x_m: Metres  # outer corner of cell (0, 0)
    origin_y_m: Metres
    cell_m: CellSize
    rows: GridSide  # along y
    columns: GridSide  # along x
    cells_zlib: GridBytes
    valid: bool = True

    def __post_init__(self) -> None:
        if self.rows * self.columns > GRID_CELLS_MAX:
            raise ValueError(f"{self.rows} rows of {self.columns} cells are too many")


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The smoothed path as it is believed now: times and poses of the key frames."""

    t_s: Seconds
    times_s: Times
    poses: Poses  # x, y, heading
    valid: bool = True
