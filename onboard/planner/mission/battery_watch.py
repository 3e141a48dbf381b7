"""When must it go home for its battery? Voltages in, and how far home is; the answer out. Pure.

The voltage of the last minutes is a line, which ends at BATTERY_LOW_V: until then the robot must be home. Where nothing
is known of that line yet, only the voltage itself counts. A battery that is not wired reports 0 V, and decides nothing.
"""

from __future__ import annotations

from collections import deque
from math import inf

import numpy as np

from common.constants import BATTERY_LOW_V, SPEED_MEDIUM_M_S

SAMPLE_S = 5.0  # one voltage is the mean of so long: it sags with every start of the motors
SAMPLES_MAX = 120  # ten minutes
SAMPLES_MIN = 12  # before a line is drawn through them
HOME_SPEED_M_S = 0.7 * SPEED_MEDIUM_M_S  # turns and rests included
RESERVE_S = 60.0  # for what the map does not show
NOT_WIRED_V = 1.0
SLOPE_MIN_V_S = 1e-5  # less is noise: ten hours for a third of a volt


class BatteryWatch:
    """`see` every report; `calls_home` may be asked at any time."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque(maxlen=SAMPLES_MAX)  # time, volts
        self._sum_v, self._count, self._since_s = 0.0, 0, -inf

    def see(self, now_s: float, battery_v: float) -> None:
        """A voltage as the board measured it."""
        if battery_v < NOT_WIRED_V:
            return
        if self._since_s == -inf:
            self._since_s = now_s
        self._sum_v, self._count = self._sum_v + battery_v, self._count + 1
        if now_s - self._since_s >= SAMPLE_S:
            self._samples.append((now_s, self._sum_v / self._count))
            self._sum_v, self._count, self._since_s = 0.0, 0, now_s

    @property
    def left_s(self) -> float:
        """Until it is empty; infinite where that is not to be seen."""
        if not self._samples:
            return inf
        times_s, volts = np.array(self._samples).T
        if volts[-3:].mean() <= BATTERY_LOW_V:
            return 0.0
        if len(times_s) < SAMPLES_MIN:
            return inf
        slope, now_v = np.polyfit(times_s - times_s[-1], volts, 1).tolist()
        return max(now_v - BATTERY_LOW_V, 0.0) / -slope if slope < -SLOPE_MIN_V_S else inf

    def calls_home(self, distance_m: float) -> bool:
        """Is there just enough left for so long a way?"""
        return self.left_s <= distance_m / HOME_SPEED_M_S + RESERVE_S
