"""The zones that count now: a person's orders in, an answer in words out; kept on disk beside the steps.

An order is in force before it is on the disk, and is answered then. Damaged zones are as good as one that forbids
everything: the robot stands until a person has drawn them anew, or removed them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.disk_worker import disk_worker
from common.fields import ZONES_MAX
from common.geometry import Pose2
from common.messages.mission import Operation, OperatorCommand
from common.side_work import SideWorker
from common.zones import KIND_OF, Zone, corners_of, gap_m, keeps_out, problem_with
from onboard.planner.zones.zone_file import read_zones, write_zones
from onboard.planner.zones.zone_guard import ZoneGuard

RETRY_S = 1.0  # after the disk refused
LOOK_S = 0.05  # between two looks whether the disk is done
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
        self._file = file
        self._disk: SideWorker[Callable[[], Any], Any] | None = None  # once there is something to store
        self._retry_s = float("-inf")
        self.revision = self._stored = 0
        loaded = _load(file) if file is not None else ()
        self.damaged = loaded is None
        self.zones: tuple[Zone, ...] = loaded or ()
        self.guard = ZoneGuard(self.zones)

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
        outcome = self._disk.result(now_s) if self._disk is not None else None
        if outcome is not None and outcome.error is not None:
            self._refused(outcome.error)
            self._retry_s = now_s + RETRY_S
        elif outcome is not None and outcome.value is not None:
            self._stored = outcome.value
        if not self._to_store or now_s < self._retry_s:
            return
        self._disk = self._disk or disk_worker("zones")
        if not self._disk.busy:
            self._disk.begin(self._store, now_s)

    def due_s(self, now_s: float) -> float:
        """When `step` has something to do (s)."""
        if self._disk is not None and self._disk.busy:
            return now_s + LOOK_S
        return max(now_s, self._retry_s) if self._to_store else float("inf")

    def close(self) -> None:
        """Stores what is not yet."""
        outcome = self._disk.close() if self._disk is not None else None
        if outcome is not None and outcome.value is not None:
            self._stored = outcome.value
        if self._to_store:
            try:
                self._store()
            except OSError as error:
                self._refused(error)

    @property
    def _to_store(self) -> bool:
        return self._file is not None and self._stored != self.revision

    def _store(self) -> int:
        """The revision that the disk has then; called by its thread."""
        revision, zones = self.revision, self.zones  # in this order: newer zones are stored once more
        if self._file is not None:
            write_zones(self._file, zones)
        return revision

    def _refused(self, error: Exception) -> None:
        _log.error("zones not stored file=%s error=%s", self._file, error)

    def _remove(self, number: int) -> ZoneAnswer:
        """Number 0 means all of them."""
        left = tuple(zone for zone in self.zones if number not in (0, zone.number))
        if len(left) == len(self.zones) and not (number == 0 and self.damaged):
            return ZoneAnswer(True, f"There is no line or area {number}." if number else "There is none.")
        self._become(left)
        return ZoneAnswer(False, "")

    def _become(self, zones: tuple[Zone, ...]) -> None:
        self.zones, self.guard, self.damaged = zones, ZoneGuard(zones), False
        self.revision += 1
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
