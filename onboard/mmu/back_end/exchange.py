"""What the front end hands over to the back end, and what comes back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.map.keyframes import Keyframe, LastSeen
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints


@dataclass(frozen=True, slots=True)
class Increment:
    """What is new in the front end. `echoes` and `rays` are (N, 6), as `ObservationStore` keeps them.

    Columns of `ranges_to_wall` (N, 8): keyframe, x and y in it (m) of the far end; the same of the near end; by how
    much the wall ahead came nearer, and how far away it still was (m).
    `prior_map`: these keyframes come from a prior map, whose odometry is the map itself.
    """

    keyframes: tuple[Keyframe, ...]
    echoes: FloatArray
    rays: FloatArray
    last: LastSeen | None = None
    prior_map: bool = False
    ranges_to_wall: FloatArray = field(default_factory=lambda: np.zeros((0, 8)))


@dataclass(frozen=True, slots=True)
class Correction:
    """Poses (K, 3) of all keyframes as estimated now, and the calibration of odometry.

    No poses at all: the back end was lost and must be given everything again.
    """

    poses: FloatArray
    drift_rad_per_m: float
    turn_scale_error: float  # rad/rad
    closures: int
    closure_path_m: float  # path at the newest loop closure that was adopted
    covariance: FloatArray  # (3, 3) of the newest of these poses
    # Drawn again from all that the back end has: the grid because the past moved, the walls also from time to time
    grid: OccupancyGrid | None = None
    walls: WallPoints | None = None
    log_lines: tuple[str, ...] = ()  # what the back end decided and why, for the log of the node's process

    @classmethod
    def lost(cls) -> Correction:
        return cls(np.zeros((0, 3)), 0.0, 0.0, 0, 0.0, np.zeros((3, 3)))
