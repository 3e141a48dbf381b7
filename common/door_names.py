"""What a person said of doors: a plate's number confirmed or put right, a room's name. Pure.

A statement is about a place: it names the record that the person saw, and goes on with that record as the map is
corrected; where the records are counted anew, with the one that lies there. What was read stays in the record.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot

from common.messages.points_of_interest import DoorStatement, DoorStatements
from common.room_number import key_of

SAME_RECORD_M = 2.0  # that far a record may have moved with the map
SAME_PLACE_M = 0.6  # doors stand further apart
STATEMENTS_MAX = 1_000  # the newest count
CONFIRMED, CORRECTED = "confirmed", "corrected"
READ = "read"


@dataclass(frozen=True, slots=True)
class DoorNote:
    """Of one door; empty where nothing was said about it."""

    poi_id: int
    x_m: float
    y_m: float
    number: str
    room_name: str


@dataclass(frozen=True, slots=True)
class Shown:
    """What counts of a door: `judged` is CONFIRMED or CORRECTED where a person has judged its number, else empty."""

    number: str
    state: str
    room_name: str = ""
    judged: str = ""


def note_by(statement: DoorStatement) -> DoorNote:
    return DoorNote(
        statement.poi_id, statement.x_m, statement.y_m, statement.number.strip(), statement.room_name.strip()
    )


def added(known: Sequence[DoorNote], new: DoorNote) -> tuple[DoorNote, ...]:
    """In place of what was said about that door before; one that says nothing takes it back."""
    before = note_for(known, new.poi_id, new.x_m, new.y_m)
    kept = [note for note in known if note is not before]
    return tuple([*kept, new] if new.number or new.room_name else kept)[-STATEMENTS_MAX:]


def note_for(known: Iterable[DoorNote], poi_id: int, x_m: float, y_m: float) -> DoorNote | None:
    """What counts for a record at that place."""
    gaps = [(note.poi_id != poi_id, hypot(note.x_m - x_m, note.y_m - y_m), note) for note in known]
    for other, gap_m, note in sorted(gaps, key=lambda gap: gap[:2]):
        if gap_m < (SAME_PLACE_M if other else SAME_RECORD_M):
            return note
    return None


def shown(number_read: str, state_read: str, note: DoorNote | None) -> Shown:
    """With what was read of the plate."""
    if note is None:
        return Shown(number_read, state_read)
    if not note.number:
        return Shown(number_read, state_read, note.room_name)
    judged = CONFIRMED if key_of(note.number) == key_of(number_read) else CORRECTED
    return Shown(note.number, READ, note.room_name, judged)


def message_of(now_s: float, command_id: int, known: Sequence[DoorNote]) -> DoorStatements:
    return DoorStatements(
        now_s,
        command_id,
        poi_ids=tuple(note.poi_id for note in known),
        x_m=tuple(note.x_m for note in known),
        y_m=tuple(note.y_m for note in known),
        numbers=tuple(note.number for note in known),
        room_names=tuple(note.room_name for note in known),
    )


def all_notes(message: DoorStatements) -> tuple[DoorNote, ...]:
    columns = message.poi_ids, message.x_m, message.y_m, message.numbers, message.room_names
    return tuple(DoorNote(*row) for row in zip(*columns, strict=True))
