"""What a board reports of itself: /proc, /sys and the disk of its state -> `BOARD[module]`, every few seconds.

comm reports for the board that it runs on, poi for its own. The reader is pure but for what it reads.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from math import nan
from pathlib import Path

from common.bus import Bus
from common.constants import BOARD_RATE_HZ
from common.messages.health import BoardState
from common.messages.topics import BOARD
from common.pace import Pace
from common.release import own_release


class BoardReporter:
    """`report` in every step; it publishes at BOARD_RATE_HZ. `folder`: on the disk that may fill up."""

    def __init__(self, module: str, folder: Path, wall_clock: Callable[[], float] = time.time) -> None:
        self._topic, self._folder, self._wall_clock = BOARD[module], folder, wall_clock
        self._pace = Pace(1.0 / BOARD_RATE_HZ)

    def report(self, bus: Bus, now_s: float) -> None:
        if self._pace.due(now_s):
            bus.publish(self._topic, read_board_state(now_s, self._wall_clock(), self._folder))


def read_board_state(now_s: float, wall_s: float, folder: Path, root: Path = Path("/")) -> BoardState:
    """Takes a tenth of a millisecond; what the system does not report is NaN or 0. `root`: where proc and sys are."""
    return BoardState(
        now_s,
        name=platform.node()[:100],
        release=own_release().name,
        uptime_s=_first_number(root / "proc/uptime"),
        load=_first_number(root / "proc/loadavg"),
        temperature_c=_temperature_c(root / "sys/class/thermal"),
        disk_free_mb=_free_mb(folder),
        wall_s=wall_s,
    )


def _first_number(file: Path) -> float:
    try:
        return float(file.read_text(encoding="ascii").split()[0])
    except (OSError, ValueError, IndexError):
        return 0.0


def _temperature_c(zones: Path) -> float:
    """Of the hottest zone."""
    return max((_first_number(zone / "temp") / 1000.0 for zone in zones.glob("thermal_zone*")), default=nan)


def _free_mb(folder: Path) -> int:
    """What a user without privileges may still write."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        return 0
    return disk.f_bavail * disk.f_frsize // 1_000_000
