"""Where `goto` leads: a door by its number, or metres on the map. The doors of a run come from its `pois.json`."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from common.fields import COORDINATE
from common.plain_text import plain
from offboard.command_center.snapshot import Finding
from offboard.recorder.run_folder import POIS_NAME, read_pois

NUMBER_LENGTH_MAX = 100

_log = logging.getLogger("command_center")


class UnknownPlace(ValueError):
    """Nobody knows where that is: one sentence."""


def coordinates(text: str) -> tuple[float, float] | None:
    """The place that X,Y names in metres; None where it is the number of a door. Raises UnknownPlace."""
    if "," not in text:
        return None
    try:
        x_m, y_m = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UnknownPlace(f"A place is written X,Y in metres, for example 3.5,-1; not {text}.") from error
    if not _on_a_map(x_m, y_m):
        raise UnknownPlace(f"A place lies within {COORDINATE.high:.0f} m of the start, which {text} does not.")
    return x_m, y_m


def find_place(text: str, findings: Iterable[Finding]) -> tuple[float, float]:
    """Position of the door with that number, or of X,Y; raises UnknownPlace."""
    place = coordinates(text)
    if place is not None:
        return place
    doors = {finding.number.casefold(): finding for finding in findings if finding.number}
    door = doors.get(text.strip().casefold())
    if door is None:
        known = ", ".join(sorted(finding.number for finding in doors.values()))
        what = f"known are {known}" if known else "no number was read yet"
        raise UnknownPlace(f"There is no door {text.strip() or '(nothing)'}: {what}; or write X,Y in metres.")
    return door.x_m, door.y_m


def findings_of_run(run_dir: Path) -> dict[int, Finding]:
    """By their id, what the recorder has written down so far; none, with a line in the log, where that is damaged."""
    file = run_dir / POIS_NAME
    try:
        return {int(record["poi_id"]): _finding(record) for record in read_pois(file)}
    except (OSError, ValueError, ArithmeticError, KeyError, TypeError, AttributeError, RecursionError) as error:
        _log.warning("points of interest unreadable file=%s error=%r", file, error)
        return {}


def _finding(record: dict[str, Any]) -> Finding:
    x_m, y_m = float(record["x_m"]), float(record["y_m"])
    if not _on_a_map(x_m, y_m):
        raise ValueError(f"no place: {x_m}, {y_m}")
    return Finding(plain(str(record["number"]), NUMBER_LENGTH_MAX), x_m, y_m)


def _on_a_map(x_m: float, y_m: float) -> bool:
    return all(COORDINATE.low <= metres <= COORDINATE.high for metres in (x_m, y_m))


def run_folder_of(config: Path | None) -> Path | None:
    """The run folder that a mesh's robot.toml stands in, `<run folder>/process/robot.toml`; None where it does not."""
    if config is None or config.resolve().parent.name != "process":
        return None
    return config.resolve().parent.parent
