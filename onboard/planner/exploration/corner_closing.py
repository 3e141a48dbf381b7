"""Corners that no sonar heard: two walls that would meet if each went on a little are taken to meet.

A wall echoes at the foot of the perpendicular only, so from the last place where the robot had it abeam up to the
corner nothing shows it: unknown floor outside the building would show through the gap, as an entry of the list that no
visit ever takes off. Where the robot drove along the gap itself it is none: there a wall would have echoed, though not
to a robot that turns. This knows walls along the grid's axes only: halls that stand square to the first one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from common.grid_cells import FREE, UNKNOWN, WALL
from onboard.planner.grid.grid_map import Mask

REACH_CELLS = 18  # so far a wall may go on
ALIKE_CELLS = 3  # around a cell of wall, for the axis that its wall runs along
PASSED_CELLS = 2  # beyond the last echo; further on a robot abeam would have heard the wall
ABEAM_CELLS = 30
OVERSHOT_CELLS = 5  # a ray may end beyond the wall


Cells = npt.NDArray[np.uint8]


def closed_corners(cells: Cells, driven_x: Mask, driven_y: Mask) -> Mask:
    """Which cells (rows, columns) of a grid are missing wall at corners; `driven_x`, `driven_y`: where the robot drove
    along that axis."""
    along_x, along_y = _Extensions(cells, driven_x), _Extensions(cells.T, driven_y.T)
    corners = along_x.all & along_y.all.T
    return along_x.up_to(corners | along_x.ends_at_wall) | along_y.up_to(corners.T | along_y.ends_at_wall).T


class _Extensions:
    """Of the walls along the second axis of `cells`, in both directions."""

    def __init__(self, cells: Cells, driven: Mask) -> None:
        wall, unknown = cells == WALL, cells == UNKNOWN
        abeam = _spread(driven, ~wall, ABEAM_CELLS)
        open_ = unknown | ((cells == FREE) & _spread(unknown, cells != WALL, OVERSHOT_CELLS))
        along, across = _count(wall), _count(wall.T).T
        self._of: list[tuple[int, Mask]] = []
        self.ends_at_wall: Mask = np.zeros_like(wall)
        for sign in (1, -1):
            tip, extension = wall & (along > across), np.zeros_like(wall)
            for step in range(1, REACH_CELLS + 1):
                tip = _shifted(tip, sign) & (open_ if step <= PASSED_CELLS else open_ & ~abeam)
                extension |= tip
            self._of.append((sign, extension))
            self.ends_at_wall |= extension & _shifted(wall & (across > along), -sign)
        self.all: Mask = self._of[0][1] | self._of[1][1]

    def up_to(self, ends: Mask) -> Mask:
        """The cells of those that lead to an end."""
        found = np.zeros_like(ends)
        for sign, extension in self._of:
            back = ends & extension
            for _ in range(REACH_CELLS):
                found |= back
                back = _shifted(back, -sign) & extension
        return found


def _shifted(mask: Mask, step: int) -> Mask:
    """By one along the second axis."""
    moved = np.zeros_like(mask)
    if step > 0:
        moved[:, 1:] = mask[:, :-1]
    else:
        moved[:, :-1] = mask[:, 1:]
    return moved


def _spread(mask: Mask, through: Mask, steps: int) -> Mask:
    """Along the first axis, both ways, as far as it leads through such cells."""
    reached = mask.copy()
    for sign in (1, -1):
        tip = mask.T
        for _ in range(steps):
            tip = _shifted(tip, sign) & through.T
            reached |= tip.T
    return reached


def _count(wall: Mask) -> npt.NDArray[np.int8]:
    """Of each cell: how many around it along the second axis."""
    padded = np.pad(wall.astype(np.int8), ((0, 0), (ALIKE_CELLS, ALIKE_CELLS)))
    total = np.zeros(wall.shape, np.int8)
    for k in range(2 * ALIKE_CELLS + 1):
        total += padded[:, k : k + wall.shape[1]]
    return total
