"""Doors and areas as CSV (RFC 4180, UTF-8): records and spaces -> text. Numbers of rooms are text there, and quoted."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

from offboard.export.halls import Space

DOORS_HEADER = ("number", "room_type", "x_m", "y_m", "space", "state", "confidence", "name", "photo")
AREAS_HEADER = ("space", "kind", "area_m2", "length_m", "width_m", "doors")
DOOR_REACH_M = 1.0  # farther from a space no door of it is
ROOM_KIND = "room"


def space_of(poi: dict[str, Any], spaces: Sequence[Space]) -> Space | None:
    """The space that a door opens to."""
    near = [(space.distance_m(poi["x_m"], poi["y_m"]), space.number, space) for space in spaces]
    distance_m, _, space = min(near, default=(DOOR_REACH_M, 0, None))
    return space if distance_m < DOOR_REACH_M else None


def space_name(space: Space | None) -> str:
    return f"{space.kind} {space.number}" if space is not None else ""


def doors_table(pois: Sequence[dict[str, Any]], spaces: Sequence[Space]) -> bytes:
    """A line per door."""
    rows = [
        (
            *(str(poi.get(name) or "") for name in ("number", "room_type")),
            *(round(float(poi[name]), 3) for name in ("x_m", "y_m")),
            space_name(space_of(poi, spaces)),
            str(poi.get("state") or ""),
            poi.get("confidence", ""),
            *(str(poi.get(name) or "") for name in ("name", "photo")),
        )
        for poi in pois
    ]
    return _csv(DOORS_HEADER, rows)


def areas_table(pois: Sequence[dict[str, Any]], spaces: Sequence[Space]) -> bytes:
    """A line per hall and area; then one per room behind a door, which the robot did not enter: without an area."""
    doors: dict[int, list[str]] = {space.number: [] for space in spaces}
    rooms: list[tuple[object, ...]] = []
    for poi in pois:
        number, space = str(poi.get("number") or "?"), space_of(poi, spaces)
        if space is not None:
            doors[space.number].append(number)
        name = str(poi.get("room_name") or "") or f"{poi.get('room_type') or ROOM_KIND} {number}"
        rooms.append((name, ROOM_KIND, "", "", "", space_name(space)))
    measured = [
        (space_name(s), s.kind, *(round(v, 2) for v in (s.area_m2, s.length_m, s.width_m)), " ".join(doors[s.number]))
        for s in spaces
    ]
    return _csv(AREAS_HEADER, [*measured, *rooms])


def _csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue().encode()
