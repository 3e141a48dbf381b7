"""The wall points as they are published: what was added since the last message, or all of them once they were redrawn.

`DrawnMap` -> `MapUpdate`, for the node and for whoever replays a log.
"""

from __future__ import annotations

from common.constants import MAP_RATE_MAX_HZ
from common.messages.mapping import MapUpdate
from common.pace import Pace
from onboard.mmu.map.drawn_map import DrawnMap


class MapIncrements:
    """`next` in every step."""

    def __init__(self) -> None:
        self._pace = Pace(1.0 / MAP_RATE_MAX_HZ)
        self._sent_points = 0
        self._sent_revision = -1

    def next(self, drawn: DrawnMap, now_s: float) -> MapUpdate | None:
        """None where there is nothing new, or the last one was a moment ago."""
        replaced = drawn.revision != self._sent_revision
        if not (replaced or drawn.wall_count > self._sent_points) or not self._pace.due(now_s):
            return None
        start = 0 if replaced else self._sent_points
        walls = drawn.wall_points(start)
        self._sent_points, self._sent_revision = start + len(walls.points_m), drawn.revision
        return MapUpdate(now_s, drawn.revision, start, walls.points_m, walls.inferred)
