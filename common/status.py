"""How every module reports ten times a second that it runs (CC_MR_03): state, error code, memory, heartbeat count.

A node calls `report` in every step -> `STATUS[module]`, read by the watchdog of comm, the recorder, the command center.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

from common.bus import Bus, LocalBus
from common.constants import STATUS_RATE_HZ
from common.errors import ErrorCode
from common.messages import STATUS, Status

_STATM = Path("/proc/self/statm")
# A step that comes a little early still counts, or a node of 0.1 s period would report at half the rate
_EARLY_S = 0.005


def resident_memory_kb() -> int:
    """Resident memory of this process now; 0 where the system does not report it."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024
    except OSError:
        return 0


class StatusPace:
    """When the next status is due: STATUS_RATE_HZ on the average, however unevenly `due` is called."""

    def __init__(self) -> None:
        self.due_s = float("-inf")  # the next one

    def due(self, now_s: float, urgent: bool = False) -> bool:
        """Whether to publish now; an urgent status is always due."""
        if not urgent and now_s < self.due_s - _EARLY_S:
            return False
        period_s = 1.0 / STATUS_RATE_HZ
        on_time = not urgent and now_s - self.due_s < period_s
        self.due_s = (self.due_s if on_time else now_s) + period_s
        return True


class StatusReporter:
    """Counts the passes of a node's loop and publishes its status, at once when error or readiness change."""

    def __init__(self, module: str) -> None:
        self._topic = STATUS[module]
        self._log = logging.getLogger(module)
        self._heartbeat_count = 0
        self._pace = StatusPace()
        self._last: tuple[str, ErrorCode, bool] | None = None  # as published
        self._logged: tuple[str, ErrorCode, bool] | None = None  # as logged

    @property
    def due_s(self) -> float:
        """When the next status is due (s): `report` must be called then, whether something has happened or not."""
        return self._pace.due_s

    def report(
        self,
        bus: Bus,
        now_s: float,
        *,
        state: str,
        error: ErrorCode = ErrorCode.OK,
        ready: bool,
        detail: str = "",
        memory_kb: int | None = None,
    ) -> None:
        """To be called in every step, and at `due_s` at the latest.

        `memory_kb` where it is not this process's own (SIM and Carrier: free SRAM).
        """
        self._heartbeat_count += 1
        current = (state, error, ready)
        # Others act on error and readiness; a mere change of state can wait for its turn, or the rate would not hold
        urgent = self._last is None or current[1:] != self._last[1:]
        if current != self._logged:
            self._logged = current
            self._log.info("state=%s error=%s ready=%s %s", state, error.name, ready, detail)
        if not self._pace.due(now_s, urgent):
            return
        if memory_kb is None:
            # Nodes in lockstep share one process: none has memory of its own, and a run must repeat to the bit
            memory_kb = 0 if isinstance(bus, LocalBus) else resident_memory_kb()
        self._last = current
        bus.publish(self._topic, Status(now_s, state, int(error), memory_kb, ready, self._heartbeat_count, detail))
