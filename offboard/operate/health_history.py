"""Memory and processor of a module over the last ten minutes: its reports -> samples. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from common.messages.health import Status

SAMPLE_S = 10.0
KEPT_S = 600.0


@dataclass(frozen=True, slots=True)
class Sample:
    """The most of what was reported within SAMPLE_S."""

    memory_kb: int
    cpu_share: float  # of one core


class HealthHistory:
    """`add` every report; `samples` of KEPT_S, oldest first."""

    def __init__(self) -> None:
        self.samples: tuple[Sample, ...] = ()
        self._kept: deque[Sample] = deque(maxlen=round(KEPT_S / SAMPLE_S))
        self._current: Sample | None = None
        self._until_s = float("-inf")

    def add(self, status: Status, now_s: float) -> None:
        sample = Sample(status.memory_kb, status.cpu_share)
        if now_s < self._until_s and self._current is not None:
            old = self._current
            self._current = Sample(max(old.memory_kb, sample.memory_kb), max(old.cpu_share, sample.cpu_share))
            return
        if self._current is not None:
            self._kept.append(self._current)
            self.samples = tuple(self._kept)
        self._current, self._until_s = sample, now_s + SAMPLE_S
