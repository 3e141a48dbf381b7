"""Limits how often something is done. Pure; the time is given."""

from __future__ import annotations


class Pace:
    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._done_s = float("-inf")

    def due(self, now_s: float) -> bool:
        """Now? Then it counts as done."""
        if now_s - self._done_s < self._period_s - 1e-6:
            return False
        self._done_s = now_s
        return True

    @property
    def due_s(self) -> float:
        """When it is due again (s); in the past where it was never done."""
        return self._done_s + self._period_s

    def reset(self) -> None:
        self._done_s = float("-inf")
