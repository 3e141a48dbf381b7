"""What the motors of the simulated body did, from the simulator's own log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

from tests.system.conftest import until

STOPPED_WITHIN_S = 0.5
STANDS_FOR_S = 1.5


class Motors(NamedTuple):
    """A line of the log, on the monotonic clock."""

    t_s: float
    pwm_left: int
    pwm_right: int
    enabled: bool

    @property
    def turning(self) -> bool:
        return (self.pwm_left, self.pwm_right) != (0, 0)

    @property
    def driving(self) -> bool:
        return self.pwm_left != 0 and self.pwm_right != 0 and self.enabled

    @property
    def dead(self) -> bool:
        return (self.pwm_left, self.pwm_right, self.enabled) == (0, 0, False)


class MotorLog:
    """The simulator's `motors.csv`."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def read(self) -> list[Motors]:
        lines = self._file.read_text(encoding="utf-8").splitlines()[1:]
        rows = [line.split(",") for line in lines]
        return [Motors(float(t), int(left), int(right), enabled == "1") for t, left, right, enabled in rows]

    def await_driving(self, after_s: float = 0.0) -> None:
        def driving() -> bool:
            newest = self.read()[-1:]
            return bool(newest) and newest[0].driving and newest[0].t_s > after_s

        until(driving, 30.0, "driving")

    def dead_after_s(self, hit_s: float) -> float:
        """Waits for PWM 0 with the driver's enable low; how long after `hit_s` it came."""
        until(lambda: any(m.dead and m.t_s > hit_s for m in self.read()), 5.0, "the end of all motion")
        return next(m.t_s for m in self.read() if m.dead and m.t_s > hit_s) - hit_s

    def turned(self, from_s: float, to_s: float) -> bool:
        """Whether a motor did at any moment between."""
        rows = self.read()
        before = [m for m in rows if m.t_s <= from_s][-1:]
        return any(m.turning for m in before + [m for m in rows if from_s < m.t_s <= to_s])

    def stands(self, for_s: float = STANDS_FOR_S) -> bool:
        """The motors do not turn, and do not for a while; that their driver is switched on is no motion."""
        since_s = time.monotonic()
        until(lambda: time.monotonic() > since_s + for_s)
        return not self.turned(since_s, time.monotonic())
