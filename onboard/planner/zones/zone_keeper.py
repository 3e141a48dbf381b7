"""The zones that count now: a person's orders in, an answer in words out; kept on disk beside the steps.

An order is in force before it is on the disk, and is answered then. Damaged zones are as good as one that forbids
everything: the robot stands until a person has drawn them anew, or removed them.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.fields import ZONES_MAX
from common.geometry import Pose2
from common.kept_file import KeptFile
from common.messages.mission import Operation, OperatorCommand
from common.zones import KIND_OF, Zone, as_json, corners_of, gap_m, keeps_out, problem_with
from onboard.planner.zones.zone_file import read_zones
from onboard.planner.zones.zone_guard import ZoneGuard

HOME = Pose2(0.0, 0.0, 0.0)
ROOM_M = 0.6  # from the middle of the robot, where it stands and at home: footprint, clearance, and what is added

_log = logging.getLogger("planner")


@dataclass(frozen=True, slots=True)
class ZoneAnswer:
    """To an order; `note` is the reason where it was refused, else what was done."""

    refused: bool
    note: str


class ZoneKeeper:
    """Without a file it forgets, for lockstep and tests. `revision` grows with every change."""

    def __init__(self, file: Path | None = None) -> None:
        self._kept = KeptFile(file, lambda: as_json(self.zones), _log)
        loaded = _load(file) if file is not None else ()
        self.damaged = loaded is None
        self.zones: tuple[Zone, ...] = loaded or ()
        self.guard = ZoneGuard(self.zones)

    @property
    def revision(self) -> int:
        return self._kept.revision

    def forbids(self, place_m: tuple[float, float]) -> bool:
        """May the robot's centre not be there?"""
        return bool(keeps_out(self.zones, np.array([place_m]))[0])

    def order(self, command: OperatorCommand, pose: Pose2) -> ZoneAnswer:
        """Takes one of ZONE_OPERATIONS, or refuses it."""
        if command.operation is Operation.REMOVE_ZONE:
            return self._remove(command.zone)
        kind, corners_m = KIND_OF[command.operation], corners_of(command)
        problem = problem_with(kind, corners_m)
        if not problem and len(self.zones) >= ZONES_MAX:
            problem = f"There are {ZONES_MAX} lines and areas already: remove one first."
        if problem:
            return ZoneAnswer(True, problem)
        zone = Zone(1 + max((zone.number for zone in self.zones), default=0), kind, corners_m)
        hindrance = _hindrance(self.zones, zone, pose)
        if hindrance:
            return ZoneAnswer(True, hindrance)
        self._become((*self.zones, zone))
        return ZoneAnswer(False, f"It is {zone.title}.")

    def step(self, now_s: float) -> None:
        """Stores what has changed."""
        self._kept.step(now_s)

    def due_s(self, now_s: float) -> float:
        """When `step` has something to do (s)."""
        return self._kept.due_s(now_s)

    def close(self) -> None:
        """Stores what is not yet."""
        self._kept.close()

    def _remove(self, number: int) -> ZoneAnswer:
        """Number 0 means all of them."""
        left = tuple(zone for zone in self.zones if number not in (0, zone.number))
        if len(left) == len(self.zones) and not (number == 0 and self.damaged):
            return ZoneAnswer(True, f"There is no line or area {number}." if number else "There is none.")
        self._become(left)
        return ZoneAnswer(False, "")

    def _become(self, zones: tuple[Zone, ...]) -> None:
        self.zones, self.guard, self.damaged = zones, ZoneGuard(zones), False
        self._kept.changed()
        _log.info("zones=%s", "; ".join(f"{zone.title} {zone.corners_m}" for zone in zones) or "none")


def _load(file: Path) -> tuple[Zone, ...] | None:
    try:
        return read_zones(file)
    except OSError as error:
        _log.error("zones not readable file=%s error=%s", file, error)
        return None


def _hindrance(zones: tuple[Zone, ...], zone: Zone, pose: Pose2) -> str:
    """Why the zone cannot be added where the robot stands now, and where it must return to; empty where it can."""
    together = (*zones, zone)
    for place, name in ((pose, "the robot stands"), (HOME, "its home is")):
        if gap_m(together, place.x_m, place.y_m) < ROOM_M:
            return f"Too near, or on the wrong side: {name} less than {ROOM_M} m inside of what stays open."
    return ""
