"""No-go lines and areas as lines of a drawing: what of their borders lies on the sheet. Pure."""

from __future__ import annotations

import numpy as np

from common.geometry import Points
from common.zones import Zone

Box = tuple[float, float, float, float]  # low x, low y, high x, high y


def outline(zone: Zone) -> Points:
    """(N, 2): a line from end to end, an area with its first corner once more."""
    sides = zone.sides
    return np.array([sides[0][0], *(end for _, end in sides)])


def border_in(zone: Zone, box: Box) -> list[Points]:
    """Its sides (2, 2), as far as they lie in a box (Liang and Barsky 1984)."""
    return [part for a, b in zone.sides if (part := _clipped(np.array(a), np.array(b), box)) is not None]


def _clipped(a: Points, b: Points, box: Box) -> Points | None:
    way, first, last = b - a, 0.0, 1.0
    for axis in (0, 1):
        for step, room in ((-way[axis], a[axis] - box[axis]), (way[axis], box[axis + 2] - a[axis])):
            if step == 0.0 and room < 0.0:
                return None
            if step < 0.0:
                first = max(first, room / step)
            elif step > 0.0:
                last = min(last, room / step)
    return np.array([a + first * way, a + last * way]) if first <= last else None
