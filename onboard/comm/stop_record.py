"""The latched stop that the robot owns, as a value and as a file.

The value holds what was stopped, released and resumed; every latched stop makes a new epoch, and a release and a resume
name the epoch that they mean. The file is replaced in one move and checked by its digest.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

RECORD_NAME = "stop_record.json"  # in the log folder of comm
STOPS_KEPT = 16  # presses that a record names; a stop holds however many there were


class DamagedRecord(ValueError):
    """The file is not what `write_record` wrote."""


@dataclass(frozen=True, slots=True)
class Stop:
    """One press: who wants the robot to stop, and the number that its repeats share."""

    source: str
    stop_id: int


@dataclass(frozen=True, slots=True)
class StopRecord:
    """As made here: a new robot, which nobody has stopped yet."""

    epoch: int = 1
    stops: tuple[Stop, ...] = ()  # latched in this epoch; none once it is released
    resumed: bool = True  # after the release
    used: bool = False  # comm has run with it: a stop may have acted that is not stored

    @property
    def latched(self) -> bool:
        return bool(self.stops)

    @property
    def sources(self) -> tuple[str, ...]:
        """Who holds it, each once, in order."""
        return tuple(sorted({stop.source for stop in self.stops}))

    def pressed(self, stop: Stop) -> StopRecord:
        """A new epoch, but for the repeat of a press that is latched now."""
        if stop in self.stops:
            return self
        return replace(self, epoch=self.epoch + 1, stops=(*self.stops, stop)[-STOPS_KEPT:], resumed=False)

    def released(self, epoch: int) -> StopRecord:
        """Nothing is latched, and a resume is missing; the same where another epoch is meant."""
        return replace(self, stops=()) if epoch == self.epoch else self

    def resumed_after(self, epoch: int) -> StopRecord:
        """The same where another epoch is meant, or where the stop is still latched."""
        return replace(self, resumed=True) if epoch == self.epoch and not self.latched else self


def read_record(file: Path) -> StopRecord | None:
    """None where there is none. Raises OSError and DamagedRecord."""
    try:
        content = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except UnicodeDecodeError as error:
        raise DamagedRecord(f"{file} is no text") from error
    body, _, digest = content.rstrip("\n").rpartition("\n")
    if _digest(body) != digest:
        raise DamagedRecord(f"the digest in {file} does not fit")
    try:
        fields: dict[str, Any] = json.loads(body)
        stops = tuple(Stop(str(stop["source"]), int(stop["stop_id"])) for stop in fields["stops"])
        return StopRecord(int(fields["epoch"]), stops, bool(fields["resumed"]), bool(fields["used"]))
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise DamagedRecord(f"{file} holds no stop record") from error


def write_record(file: Path, record: StopRecord) -> None:
    """Durable when it returns. Raises OSError, and then the old one is still there."""
    body = json.dumps(asdict(record))
    part = file.with_suffix(".part")
    with part.open("w", encoding="utf-8") as stream:
        stream.write(f"{body}\n{_digest(body)}\n")
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(file)
    folder = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()
