"""Doors and plates: records, and the planner's requests about them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from common.fields import CommandId, DoorIds, DoorPlaces, DoorTexts, Metres, Photo, PoiId, Radians, Seconds, Share, Word


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


@dataclass(frozen=True, slots=True)
class DoorStatement:
    """What a person says of a door, all of it at once: the plate's number, the room's name; both empty: nothing."""

    t_s: Seconds
    poi_id: PoiId  # of the record that the person saw, and where it stood
    x_m: Metres
    y_m: Metres
    number: Word = ""  # that counts in place of what was read; the same confirms it
    room_name: Word = ""
    valid: bool = True
    command_id: CommandId = 0  # repeated with the same one until DoorStatements acknowledges it


@dataclass(frozen=True, slots=True)
class DoorStatements:
    """All that was said of doors in this run (common/door_names.py), once it is on the disk."""

    t_s: Seconds
    command_id: CommandId  # of the newest DoorStatement that is among them
    poi_ids: DoorIds
    x_m: DoorPlaces
    y_m: DoorPlaces
    numbers: DoorTexts
    room_names: DoorTexts
    valid: bool = True
