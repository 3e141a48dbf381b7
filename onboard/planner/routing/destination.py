"""A place to drive to, given by its position: where on the grid a path to it may end."""

from __future__ import annotations

from onboard.planner.grid.grid_map import Cell, GridMap

NEAR_CELLS = 1  # of the grid, around a place to drive to
FAR_CELLS = 4  # where the footprint cannot stand at the place itself


def has_floor(grid: GridMap, place_m: tuple[float, float]) -> bool:
    """May the robot stand at that place of the map, or so near to it that a drive there would end?"""
    near = grid.around(*place_m, FAR_CELLS)
    return any(grid.contains(cell) and bool(grid.standable(cell)) for cell in near)


def cells_at(grid: GridMap, place_m: tuple[float, float], exact: bool) -> set[Cell]:
    """Where a path may end; `exact`: at the place itself."""
    return grid.around(*place_m, NEAR_CELLS if exact else FAR_CELLS)
