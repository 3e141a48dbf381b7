"""How every module reports ten times a second that it runs (CC_MR_03): state, error code, memory, heartbeat count.

A node calls `report` in every step -> `STATUS[module]`, read by the watchdog of comm, the recorder, the command center.
"""

from __future__ import annotations

import logging
import os
import time
from pathlib import Path

from common.bus import Bus, LocalBus
from common.constants import STATUS_RATE_HZ
from common.errors import ErrorCode
from common.messages.health import Status
from common.messages.topics import STATUS
from common.pace import Pace

_STATM = Path("/proc/self/statm")
MEMORY_PERIOD_S = 1.0  # reading it costs more than all else in a status


def resident_memory_kb() -> int:
    """Resident memory of this process now; 0 where the system does not report it."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024
    except OSError:
        return 0


class StatusPace(Pace):
    """When the next status is due."""

    def __init__(self) -> None:
        super().__init__(1.0 / STATUS_RATE_HZ)


class StatusReporter:
    """Counts the passes of a node's loop and publishes its status, at once when error or readiness change."""

    def __init__(self, module: str) -> None:
        self._topic = STATUS[module]
        self._log = logging.getLogger(module)
        self._heartbeat_count = 0
        self._pace, self._memory_pace = StatusPace(), Pace(MEMORY_PERIOD_S)
        self._memory_kb, self._cpu_share = 0, 0.0
        self._measured_s: tuple[float, float] | None = None  # wall and processor time of the newest measurement
        self._last: tuple[str, ErrorCode, bool] | None = None  # as published
        self._logged: tuple[str, ErrorCode, bool] | None = None  # as logged

    @property
    def due_s(self) -> float:
        """When the next status is due (s): `report` must be called then, whether something has happened or not."""
        return self._pace.due_s

    @property
    def latest_s(self) -> float:
        """Like `due_s`, for a node that messages step about as often: the status waits for the next of these steps."""
        return self._pace.latest_s

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
        cpu_share = 0.0
        if memory_kb is None:
            self._measure(bus, now_s)
            memory_kb, cpu_share = self._memory_kb, self._cpu_share
        self._last = current
        status = Status(now_s, state, int(error), memory_kb, ready, self._heartbeat_count, detail, cpu_share=cpu_share)
        bus.publish(self._topic, status, news=urgent)

    def _measure(self, bus: Bus, now_s: float) -> None:
        """Memory and processor of this process, now and then."""
        # Nodes in lockstep share one process: none has memory of its own, and a run must repeat to the bit
        if isinstance(bus, LocalBus) or not self._memory_pace.due(now_s):
            return
        self._memory_kb = resident_memory_kb()
        measured_s = time.monotonic(), time.process_time()
        if self._measured_s is not None and measured_s[0] > self._measured_s[0]:
            wall_s, cpu_s = (new - old for new, old in zip(measured_s, self._measured_s, strict=True))
            self._cpu_share = round(cpu_s / wall_s, 3)
        self._measured_s = measured_s
