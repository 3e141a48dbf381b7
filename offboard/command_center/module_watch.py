"""How fresh and how frequent what a module sends is, judged by arrival on the local monotonic clock. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum

from common.messages.health import Status
from offboard.operate.alerts import error_info
from offboard.operate.health_history import Sample

STALE_S = 1.0
GONE_S = 5.0
RATE_WINDOW_S = 2.0


class Freshness(Enum):
    LIVE = "live"
    STALE = "STALE"
    GONE = "GONE"
    NEVER = "no message"


def freshness(age_s: float) -> Freshness:
    """Of a value that arrived `age_s` ago; infinite when none did."""
    if age_s == float("inf"):
        return Freshness.NEVER
    if age_s > GONE_S:
        return Freshness.GONE
    return Freshness.STALE if age_s > STALE_S else Freshness.LIVE


@dataclass(slots=True)
class RateMeter:
    """Messages per second over the last RATE_WINDOW_S."""

    arrivals_s: deque[float] = field(default_factory=deque)
    _since_s: float | None = None

    def add(self, count: int, now_s: float) -> None:
        if count and self._since_s is None:
            self._since_s = now_s
        self.arrivals_s.extend([now_s] * count)
        while self.arrivals_s and self.arrivals_s[0] <= now_s - RATE_WINDOW_S:
            self.arrivals_s.popleft()

    def rate_hz(self, now_s: float) -> float:
        if self._since_s is None:
            return 0.0
        return len(self.arrivals_s) / min(RATE_WINDOW_S, max(now_s - self._since_s, 0.5))


@dataclass(frozen=True, slots=True)
class ModuleRow:
    """A module as one line shows it."""

    module: str
    status: Status | None
    age_s: float
    rate_hz: float
    samples: tuple[Sample, ...] = ()

    @property
    def freshness(self) -> Freshness:
        return freshness(self.age_s)

    @property
    def error(self) -> tuple[str, str]:
        """Meaning and action."""
        info = error_info(self.status.error_code if self.status is not None else 0)
        return info.meaning, info.action
