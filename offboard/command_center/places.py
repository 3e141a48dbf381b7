"""Where `goto` leads: a door by its number, or metres on the map. The doors of a run come from its `pois.json`."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from common.door_names import DoorNote, note_for, shown
from common.errors import sentence
from common.fields import COORDINATE
from common.room_number import key_of
from offboard.command_center.snapshot import Finding
from offboard.runs.run_folder import POIS_NAME, RunFolderError, read_pois

_log = logging.getLogger("command_center")


class UnknownPlace(ValueError):
    """Nobody knows where that is: one sentence."""


def coordinates(text: str) -> tuple[float, float] | None:
    """The place that X,Y names in metres; None where it is the number of a door. Raises UnknownPlace."""
    text = text.strip()
    if "," not in text:
        return None
    try:
        x_m, y_m = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UnknownPlace(f"A place is written X,Y in metres, for example 3.5,-1; not {text}.") from error
    if not all(COORDINATE.low <= metres <= COORDINATE.high for metres in (x_m, y_m)):
        raise UnknownPlace(f"A place lies within {COORDINATE.high:.0f} m of the start, which {text} does not.")
    return x_m, y_m


def find_place(text: str, findings: Iterable[Finding]) -> tuple[float, float]:
    """Position of the door with that number in its shown form or as its key, or of X,Y; raises UnknownPlace."""
    place = coordinates(text)
    if place is not None:
        return place
    try:
        _, door = find_door(text, dict(enumerate(findings)))
    except UnknownPlace as error:
        raise UnknownPlace(f"{str(error).rstrip('.')}; or write X,Y in metres.") from error
    return door.x_m, door.y_m


def find_door(text: str, findings: Mapping[int, Finding]) -> tuple[int, Finding]:
    """The door with that number in its shown form or as its key, else with that name, or #ID: its id too. Raises
    UnknownPlace."""
    doors = {key_of(finding.number): (poi_id, finding) for poi_id, finding in findings.items() if finding.number}
    names = {_folded(finding.room_name): (poi_id, finding) for poi_id, finding in findings.items()}
    ids = {f"#{poi_id}": (poi_id, finding) for poi_id, finding in findings.items()}
    door = ids.get(text.strip()) or doors.get(key_of(text)) or (names.get(_folded(text)) if text.strip() else None)
    if door is None:
        known = ", ".join(sorted(finding.number for _, finding in doors.values()))
        what = f"known are {known}" if known else "no number was read yet"
        raise UnknownPlace(f"There is no door {text.strip() or '(nothing)'}: {what}.")
    return door


def named(poi_id: int, finding: Finding, notes: Iterable[DoorNote]) -> Finding:
    """As it counts with what people said of doors."""
    counts = shown(finding.number_read, "", note_for(notes, poi_id, finding.x_m, finding.y_m))
    return replace(finding, number=counts.number, room_name=counts.room_name, judged=counts.judged)


def _folded(name: str) -> str:
    return " ".join(name.casefold().split())


def findings_of_run(run_dir: Path) -> dict[int, Finding]:
    """By their id, what the recorder has written down so far; empty where there is nothing that can be read."""
    try:
        records = read_pois(run_dir / POIS_NAME)
    except (RunFolderError, OSError) as error:
        _log.warning("doors of the run unknown: %s", sentence(error))
        return {}
    return {
        record["poi_id"]: Finding(
            record.get("number") or "",
            record["x_m"],
            record["y_m"],
            str(record.get("room_name") or ""),
            str(record.get("number_read", record.get("number")) or ""),
            str(record.get("judged") or ""),
        )
        for record in records
        if record.get("poi_id") is not None
    }


def run_folder_of(config: Path | None) -> Path | None:
    """The run folder that a mesh's robot.toml stands in, `<run folder>/process/robot.toml`; None where it does not."""
    if config is None or config.resolve().parent.name != "process":
        return None
    return config.resolve().parent.parent
