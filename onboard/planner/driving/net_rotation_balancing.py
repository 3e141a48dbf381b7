"""The direction of a half turn: the one that leaves the smallest net rotation.

The scale of a cheap gyro is off by a fraction of a percent: after three more full turns to the right than to the left
the heading is wrong by some degrees. Where both directions of a turn are about as long, one of them cancels that.
"""

from __future__ import annotations

from math import copysign, pi, radians

from common.geometry import wrap_angle

LONG_TURN_MAX_RAD = radians(240.0)
AHEAD_RAD = radians(120.0)  # at most: near 180 degrees the direction of a turn is ambiguous


class NetRotationBalancing:
    """To be called at every command."""

    def __init__(self) -> None:
        self._net_rotation_rad = 0.0  # left turns less right turns since the beginning
        self._yaw_rad: float | None = None

    def turn_rad(self, yaw_rad: float, turn_rad: float, then_rad: float = 0.0) -> float:
        """The turn to request, at most 120 deg at once: `turn_rad` (-pi to pi, left positive) or the other way round.

        `yaw_rad`: the robot's yaw now. `then_rad`: the next turn after this one, as far as it is known.
        """
        if self._yaw_rad is not None:
            self._net_rotation_rad += wrap_angle(yaw_rad - self._yaw_rad)
        self._yaw_rad = yaw_rad
        other_rad = turn_rad - copysign(2 * pi, turn_rad)
        if abs(other_rad) <= LONG_TURN_MAX_RAD:
            turn_rad = min(turn_rad, other_rad, key=lambda turn: abs(self._net_rotation_rad + turn + then_rad))
        return max(-AHEAD_RAD, min(AHEAD_RAD, turn_rad))
