"""The records of doors that were published: which of them a door belongs to; kept over a restart of the process.

A record keeps its number for good: the run's files and what people said of a door go by it.
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import Any

from common.fields import POI_ID_MAX
from common.kept_file import KeptFile
from onboard.poi.doors.door_association import Door, State
from onboard.poi.doors.observations import Place, Sign, move
from onboard.poi.placement.map_shift import MapShift
from onboard.poi.placement.wall_line import WallPoint

DOORS_NAME = "doors.json"  # in the log folder of poi; belongs to the map of mmu
SAME_RECORD_M = 0.6  # a door nearer to a record belongs to it; doors stand further apart
UNPUBLISHED = ("", "", "")

_log = logging.getLogger("poi")


@dataclass(slots=True)
class Published:
    """A record as it was published last, with the place that was published and where that lies by now."""

    poi_id: int
    place: Place
    sent: WallPoint
    content: tuple[str, str, str] = UNPUBLISHED  # state, number, room type
    quality: float = -2.0
    sign: Sign | None = field(default=None, compare=False)  # as this process observed it

    def improves(self, door: Door) -> bool:
        """Is what is known of the door now as good as what was read of it before a restart?"""
        return self.sign is not None or self.content[0] != State.READ.value or door.state is State.READ


class PublishedRecords:
    """Without a file they are forgotten, for lockstep and tests."""

    def __init__(self, file: Path | None = None) -> None:
        self._records = _load(file) if file is not None else []
        self._kept = KeptFile(file, lambda: [_row(record) for record in list(self._records)], _log)

    def __len__(self) -> int:
        return len(self._records)

    def of(self, door: Door) -> Published | None:
        """The record of this door: the one with its plate, else the nearest within SAME_RECORD_M."""
        for record in self._records:
            if door.sign is not None and record.sign is door.sign:
                return record
        nearest = min(self._records, key=lambda record: record.place.point.distance_m(door.centre), default=None)
        return nearest if nearest is not None and nearest.place.point.distance_m(door.centre) < SAME_RECORD_M else None

    def begin(self, door: Door) -> Published:
        """A new record, with the next number."""
        number = 1 + max((record.poi_id for record in self._records), default=0)
        self._records.append(Published(number, Place.of(door.centre, door.seen_s), door.centre))
        return self._records[-1]

    def move(self, shift: MapShift) -> None:
        """Moves all of them with the map; what was known before a restart stays."""
        move([record.place for record in self._records], shift)

    def changed(self) -> None:
        self._kept.changed()

    def step(self, now_s: float) -> None:
        """Stores what has changed."""
        self._kept.step(now_s)

    def close(self) -> None:
        self._kept.close()


def _row(record: Published) -> list[Any]:
    point = record.place.point
    return [record.poi_id, point.x_m, point.y_m, point.normal_rad, *record.content, record.quality]


def _load(file: Path) -> list[Published]:
    """None of them where the file is damaged: then numbers begin anew."""
    try:
        return [_record(row) for row in json.loads(file.read_text(encoding="utf-8"))]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, TypeError, RecursionError) as error:
        _log.error("doors not readable, their numbers begin anew file=%s error=%s", file, error)
        return []


def _record(row: list[Any]) -> Published:
    """Raises ValueError or TypeError."""
    poi_id, x_m, y_m, normal_rad, state, number, room_type, quality = row
    texts, numbers = (state, number, room_type), (x_m, y_m, normal_rad, quality)
    if type(poi_id) is not int or not 0 < poi_id <= POI_ID_MAX or not all(isinstance(text, str) for text in texts):
        raise ValueError(f"no record: {row}")
    if not all(isfinite(value) for value in numbers):
        raise ValueError(f"no place: {row}")
    point = WallPoint(x_m, y_m, normal_rad)
    return Published(poi_id, Place.of(point, -inf), point, texts, quality)
