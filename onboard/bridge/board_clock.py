"""The board's milliseconds -> the bridge's own clock. Pure.

A line is never early: the least (arrival - sent) over a window is the offset of the two clocks plus the shortest way,
and waiting in buffers does not count (as in Mills' minimum filter for NTP, RFC 5905).
"""

from __future__ import annotations

from collections import deque

WINDOW_S = 10.0
_WRAP_MS = 1 << 32


class BoardClock:
    """Made anew for each session of the board."""

    def __init__(self) -> None:
        self._last_ms: int | None = None
        self._total_ms = 0
        # Arrivals with their offsets, both rising: the first is the least within the window
        self._offsets: deque[tuple[float, float]] = deque()

    def jumped_back(self, time_ms: int) -> bool:
        """This time lies before the last one by more than lines can be out of order: the board has restarted."""
        if self._last_ms is None:
            return False
        step_ms = (time_ms - self._last_ms) % _WRAP_MS
        return step_ms > _WRAP_MS // 2 and _WRAP_MS - step_ms > 200

    def to_s(self, time_ms: int, now_s: float) -> float:
        """The time of a line that arrives at `now_s`, on the clock of `now_s`; never later than `now_s`."""
        if self._last_ms is not None:
            step_ms = (time_ms - self._last_ms) % _WRAP_MS
            self._total_ms += step_ms if step_ms <= _WRAP_MS // 2 else step_ms - _WRAP_MS
        else:
            self._total_ms = time_ms
        self._last_ms = time_ms
        sent_s = self._total_ms / 1000.0
        offset_s = now_s - sent_s
        while self._offsets and self._offsets[-1][1] >= offset_s:
            self._offsets.pop()
        self._offsets.append((now_s, offset_s))
        while self._offsets[0][0] < now_s - WINDOW_S:
            self._offsets.popleft()
        return sent_s + self._offsets[0][1]
