"""Points of interest that the recorder has kept: what a restarted visualizer knows of doors found before it began.

The run folder -> `PoiRecord`s and photos. Whoever keeps them elsewhere provides another `PoiStore`.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

from common.door_names import DoorNote, note_for, shown
from common.messages.points_of_interest import PointOfInterest
from offboard.runs.run_folder import POIS_NAME, RunFolderError, read_pois

_log = logging.getLogger("visualizer")


@dataclass(frozen=True, slots=True)
class PoiRecord:
    """One entry of the list of points of interest, without its photo."""

    poi_id: int
    name: str
    description: str
    x_m: float
    y_m: float
    number: str
    room_type: str
    confidence: float
    state: str  # read, doubtful, unread
    t_s: float
    has_photo: bool
    number_read: str = ""  # of the plate; `number` and `state` are what counts
    state_read: str = ""
    room_name: str = ""  # by a person
    judged: str = ""  # what a person said of the number: confirmed or corrected


_KEPT = ("poi_id", "name", "description", "x_m", "y_m", "number", "room_type", "confidence", "state", "t_s")


def record_of(poi: PointOfInterest) -> PoiRecord:
    """The record of a message, without the photo."""
    kept = {name: getattr(poi, name) for name in _KEPT}
    has_photo = bool(poi.photo_jpeg)
    return PoiRecord(**kept, has_photo=has_photo, number_read=poi.number, state_read=poi.state)


def with_notes(record: PoiRecord, notes: Sequence[DoorNote]) -> PoiRecord:
    """As it counts with what people said of doors."""
    of_it = note_for(notes, record.poi_id, record.x_m, record.y_m)
    counts = shown(record.number_read, record.state_read, of_it)
    return dataclasses.replace(record, **dataclasses.asdict(counts))


class PoiStore(Protocol):
    """Where the points of interest of this run are kept. Used by two threads: `read` by one, `photo` by another."""

    def read(self) -> list[PoiRecord] | None:
        """All records; None when there is nothing new since the last call."""

    def photo(self, poi_id: int) -> bytes | None:
        """The photo as JPEG; None when there is none."""


class NoPois:
    """Nobody keeps a run on this machine: only what comes over the bus is shown."""

    def read(self) -> list[PoiRecord] | None:
        return None

    def photo(self, poi_id: int) -> bytes | None:
        return None


class RunFolderPois:
    """`pois.json` and the photos beside it, as the recorder writes them while the run goes on."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._seen: tuple[int, int] | None = None  # time of change and size of the file
        self._photos: dict[int, str] = {}
        self._readable = True

    def read(self) -> list[PoiRecord] | None:
        file = self._run_dir / POIS_NAME
        try:
            stat = file.stat()
            if (stat.st_mtime_ns, stat.st_size) == self._seen:
                return None
            entries = read_pois(file)
            records = [_record(entry) for entry in entries]
        except FileNotFoundError:
            return None
        except (OSError, RunFolderError, ValueError, KeyError, TypeError) as error:
            if self._readable:
                _log.warning("points of interest unreadable file=%s error=%r", file, error)
            self._readable = False
            return None
        self._readable = True
        self._seen = stat.st_mtime_ns, stat.st_size
        self._photos = {int(entry["poi_id"]): entry["photo"] for entry in entries if entry.get("photo")}
        return records

    def photo(self, poi_id: int) -> bytes | None:
        name = self._photos.get(poi_id)
        if name is None:
            return None
        file = (self._run_dir / name).resolve()
        if not file.is_relative_to(self._run_dir.resolve()):
            return None
        try:
            return file.read_bytes()
        except OSError:
            return None


def _record(entry: dict[str, Any]) -> PoiRecord:
    if not isfinite(float(entry["x_m"]) + float(entry["y_m"])):
        raise ValueError("a place that is none")
    return PoiRecord(
        poi_id=int(entry["poi_id"]),
        name=str(entry.get("name") or ""),
        description=str(entry.get("description") or ""),
        x_m=float(entry["x_m"]),
        y_m=float(entry["y_m"]),
        number=str(entry.get("number") or ""),
        room_type=str(entry.get("room_type") or ""),
        confidence=float(entry.get("confidence") or 0.0),
        state=str(entry.get("state") or ""),
        t_s=float(entry.get("t_s") or 0.0),
        has_photo=bool(entry.get("photo")),
        number_read=str(entry.get("number_read", entry.get("number")) or ""),
        state_read=str(entry.get("state_read", entry.get("state")) or ""),
        room_name=str(entry.get("room_name") or ""),
        judged=str(entry.get("judged") or ""),
    )
