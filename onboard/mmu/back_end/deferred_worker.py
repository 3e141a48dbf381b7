"""The back end in this very process, for lockstep and replay.

Its correction comes after a fixed time of the messages' clock on any machine, so that a run repeats to the bit.
"""

from __future__ import annotations

from pathlib import Path

from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.back_end.map_builder import MapBuilder

LATENCY_S = 0.4  # of the messages' clock: stands for the time that the back end takes; the sensitivity was not measured


class DeferredWorker:
    """`work` does what is due. The driver of the steps may call it between them; otherwise `collect` does."""

    def __init__(self, map_file: Path | None = None, latency_s: float = LATENCY_S, gyro_led: bool = True) -> None:
        self._builder = MapBuilder(map_file, gyro_led)
        self._latency_s = latency_s
        self._increment: Increment | None = None
        self._correction: Correction | None = None
        self._due_s = 0.0

    @property
    def busy(self) -> bool:
        return self._increment is not None or self._correction is not None

    def submit(self, increment: Increment, now_s: float) -> None:
        self._increment, self._due_s = increment, now_s + self._latency_s

    def work(self) -> None:
        if self._increment is not None:
            self._correction = self._builder.take(self._increment)
            self._builder.save()
            self._increment = None

    def collect(self, now_s: float) -> Correction | None:
        if not self.busy or now_s < self._due_s:
            return None
        self.work()
        correction, self._correction = self._correction, None
        return correction

    def close(self) -> None:
        """Nothing is held open."""
