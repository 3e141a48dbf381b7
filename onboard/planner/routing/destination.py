"""A place to drive to, given by its position: where on the grid a path to it may end."""

from __future__ import annotations

from math import hypot

from onboard.planner.grid.grid_map import Cell, GridMap, Mask

NEAR_CELLS = 1  # of the grid, around a place to drive to
FAR_CELLS = 4  # where the footprint cannot stand at the place itself


def has_floor(grid: GridMap, place_m: tuple[float, float]) -> bool:
    """May the robot stand at that place of the map, or so near to it that a drive there would end?"""
    near = grid.around(*place_m, FAR_CELLS)
    return any(grid.contains(cell) and bool(grid.standable(cell)) for cell in near)


def nearest_cells(grid: GridMap, place_m: tuple[float, float], reachable: Mask) -> set[Cell]:
    """Where the footprint can stand nearest to a place at which it cannot: before a door, which is in a wall, on the
    side that paths lead to; `reachable` (rows, columns)."""
    gaps_m = {
        cell: hypot(grid.centre(cell)[0] - place_m[0], grid.centre(cell)[1] - place_m[1])
        for cell in grid.around(*place_m, FAR_CELLS)
        if grid.contains(cell) and bool(reachable[cell]) and bool(grid.standable(cell))
    }
    least_m = min(gaps_m.values(), default=0.0)
    return {cell for cell, gap_m in gaps_m.items() if gap_m <= least_m + grid.cell_m / 4}


def cells_at(grid: GridMap, place_m: tuple[float, float], exact: bool) -> set[Cell]:
    """Where a path may end; `exact`: at the place itself."""
    return grid.around(*place_m, NEAR_CELLS if exact else FAR_CELLS)
