"""How much a process replies to queries for earlier messages: live messages must not wait for it. Pure.

A token bucket of bytes. Every reply costs a minimum, so that the budget bounds their rate as well.
"""

from __future__ import annotations

from math import inf

RATE_BYTES_S = 2_000_000  # what a fair Wi-Fi carries; what is queried steers no robot
BURST_BYTES = 4_000_000  # all that a process has kept, for one who has just come
ANSWER_BYTES_MIN = 10_000  # what a reply costs at least: two hundred a second in the long run


class ReplyBudget:
    """Of all topics of one process together; whoever uses it from several threads locks it."""

    def __init__(self) -> None:
        self._left_bytes = float(BURST_BYTES)
        self._updated_s = inf

    def allows(self, answer_bytes: int, now_s: float) -> bool:
        """Whether a reply may go out now. One longer than the burst may, when the whole budget is left."""
        self._left_bytes += max(0.0, now_s - self._updated_s) * RATE_BYTES_S
        self._left_bytes = min(self._left_bytes, BURST_BYTES)
        self._updated_s = now_s
        cost_bytes = max(answer_bytes, ANSWER_BYTES_MIN)
        if self._left_bytes < min(cost_bytes, BURST_BYTES):
            return False
        self._left_bytes -= cost_bytes
        return True
