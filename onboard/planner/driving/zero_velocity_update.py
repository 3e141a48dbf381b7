"""Zero-velocity update: standing still now and then, so that the gyro's bias is measured anew.

The bias of a cheap gyro wanders while the robot drives: without a rest its heading is off by half a degree after one
minute and by several after five, and nothing but walls would show it. What is lost between two rests grows with the
time to the power of 1.5: many short rests are worth more than few long ones, until a rest measures the bias no better
than the gyro has kept it.
"""

from __future__ import annotations

REST_EVERY_S = 12.0
REST_S = 1.2  # of standing: a hundred samples of the gyro


class ZeroVelocityUpdate:
    """To be called in every step. At the first one the board has just measured the bias, or it would not be ready."""

    def __init__(self) -> None:
        self._rested_s: float | None = None
        self._standing_since_s: float | None = None

    def due(self, now_s: float, standing: bool) -> bool:
        """Must the robot stand now? `standing`: as SIM reports, which measures the bias as long as that holds."""
        if not standing:
            self._standing_since_s = None
        elif self._standing_since_s is None:
            self._standing_since_s = now_s
        rested = self._standing_since_s is not None and now_s - self._standing_since_s >= REST_S
        if rested or self._rested_s is None:
            self._rested_s = now_s
        return now_s - self._rested_s > REST_EVERY_S
