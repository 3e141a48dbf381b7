"""Doors and plates: records, and the planner's requests about them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from common.fields import (
    Metres,
    Photo,
    PoiId,
    Radians,
    Seconds,
    Share,
    Word,
)


class PoiCommand(Enum):
    STOP = "STOP"
    CONTINUE = "CONTINUE"
    REVERSE = "REVERSE"
    GOTO = "GOTO"


@dataclass(frozen=True, slots=True)
class PoiRequest:
    """Planner_Command: hold, go on, go back, or stand at a pose for another photo."""

    t_s: Seconds
    command: PoiCommand
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    heading_rad: Radians = 0.0
    valid: bool = True


@dataclass(frozen=True, slots=True)
class PointOfInterest:
    """Current_POI: one record per door (decision 28)."""

    t_s: Seconds
    poi_id: PoiId
    name: Word
    description: Word
    x_m: Metres
    y_m: Metres
    number: Word  # in its shown form; found by `room_number.key_of`
    room_type: Word
    confidence: Share
    state: Word
    photo_jpeg: Photo = b""
    valid: bool = True
