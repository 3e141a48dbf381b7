"""Where the wall time of a simulated run goes: onto one account at a time, so that all of them add up to the whole."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping

WORLD = PHYSICS, IMU, SONARS, FIRMWARE, CAMERA = "physics", "IMU", "sonars", "firmware and serial line", "camera"
BUS, BESIDE, REST = "bus", "work beside the nodes", "rest"  # and each node has the account of its name


class Stopwatch:
    """Runs from its making on; `enter` says what the time from now on belongs to."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forgets what was spent so far."""
        self._spent_s: dict[str, float] = defaultdict(float)
        self._account = REST
        self._since_s = time.perf_counter()

    def enter(self, account: str) -> str:
        """Returns the account that was open until now, to enter it again where one piece of work is part of another."""
        now_s = time.perf_counter()
        before = self._account
        self._spent_s[before] += now_s - self._since_s
        self._account, self._since_s = account, now_s
        return before

    def move(self, account: str, other: str, seconds: float) -> None:
        """Part of what was spent on an account belongs to another."""
        self._spent_s[account] -= seconds
        self._spent_s[other] += seconds

    def spent_s(self) -> Mapping[str, float]:
        """Wall time by account so far, the open one included."""
        self.enter(self._account)
        return dict(self._spent_s)
