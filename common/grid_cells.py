"""What a cell of the occupancy grid holds (`GridUpdate`), in one place for who makes, reads and shows it."""

from __future__ import annotations

UNKNOWN, FREE, WALL = 0, 1, 2
