"""Draws what was observed from keyframes into the occupancy grid."""

from __future__ import annotations

from common.geometry import FloatArray
from onboard.mmu.map.keyframes import in_map
from onboard.mmu.map.occupancy import OccupancyGrid


def draw(grid: OccupancyGrid, echoes: FloatArray, rays: FloatArray, poses: FloatArray) -> None:
    """Echoes (N, 6) and rays (M, 6) as `ObservationStore` keeps them, with the poses (K, 3) of all keyframes."""
    starts, directions = in_map(rays, poses)
    if len(rays):
        grid.add_footprint(starts)
    if len(echoes):
        grid.add_walls(*in_map(echoes, poses))
    if len(rays):
        grid.add_rays(starts, directions, rays[:, 5])
