"""Motors and wheels of the simulated body: PWM -> rotation (what the encoders measure) -> motion over the floor.

Rotation and motion differ by the errors of a run: wheel diameters, track, slip and bumps.
"""

from __future__ import annotations

from math import exp, floor, inf, pi, sqrt
from random import Random

from common.constants import ENCODER_TICKS_PER_TURN, WHEEL_DIAMETER_M, WHEEL_TRACK_M
from offboard.simulator.error_profiles import RunErrors

MOTOR_TIME_CONSTANT_S = 0.060
DEAD_ZONE_PWM = 15
FULL_SPEED_PWM = 200  # at which the rim runs at FULL_SPEED_M_S
FULL_SPEED_M_S = 0.30
FRICTION_M_S2 = 2.0  # a free wheel at mapping speed stands after 80 ms
SLIP_LENGTH_M = 0.25  # correlation length of the slip
BUMP_DURATION_S = 0.05

_SPEED_PER_PWM_M_S = FULL_SPEED_M_S / (FULL_SPEED_PWM - DEAD_ZONE_PWM)
_STANDING_M_S = 1e-4


class DriveTrain:
    """Two DC motors with their wheels. State: the rim speed (m/s) of each wheel as if it had the nominal diameter."""

    def __init__(self, errors: RunErrors, rng: Random, step_s: float) -> None:
        self._errors, self._profile, self._rng, self._step_s = errors, errors.profile, rng, step_s
        self._motor_response = 1.0 - exp(-step_s / MOTOR_TIME_CONSTANT_S)
        self._track_m = WHEEL_TRACK_M * errors.track_factor
        self._ticks_per_m = ENCODER_TICKS_PER_TURN / (pi * WHEEL_DIAMETER_M)
        # A random walk of the rolled distance, made smooth: a share of it that changes over SLIP_LENGTH_M
        self._slip_sd = self._profile.slip_sd_per_sqrt_m / sqrt(2.0 * SLIP_LENGTH_M)
        self._rim_m_s = [0.0, 0.0]
        self._rolled_m = [0.0, 0.0]
        self._ticks = 0, 0
        self._slip = [rng.gauss(0.0, self._slip_sd), rng.gauss(0.0, self._slip_sd)]
        self._next_bump_m = self._bump_distance_m()
        self._bump_rad_s = 0.0
        self._bump_left_s = 0.0

    def step(self, pwm_left: int, pwm_right: int, enabled: bool) -> tuple[float, float]:
        """Drives for one step at PWM -255..255; returns speed (m/s) and yaw rate (rad/s) of an unblocked body."""
        left = self._wheel_speed(0, pwm_left, enabled, self._errors.left_diameter_factor)
        right = self._wheel_speed(1, pwm_right, enabled, self._errors.right_diameter_factor)
        yaw_rate_rad_s = (right - left) / self._track_m
        if self._profile.bump_spacing_m != inf:
            yaw_rate_rad_s += self._bump(abs(left + right) * 0.5 * self._step_s)
        return 0.5 * (left + right), yaw_rate_rad_s

    def edges(self) -> tuple[int, int]:
        """Signed quadrature edges of both encoders since the last call."""
        rolled_m, before = self._rolled_m, self._ticks
        left, right = floor(rolled_m[0] * self._ticks_per_m), floor(rolled_m[1] * self._ticks_per_m)
        self._ticks = left, right
        return left - before[0], right - before[1]

    def _wheel_speed(self, wheel: int, pwm: int, enabled: bool, diameter_factor: float) -> float:
        rim_m_s = self._rim_m_s[wheel]
        if enabled:
            if pwm > DEAD_ZONE_PWM:
                drive_m_s = (pwm - DEAD_ZONE_PWM) * _SPEED_PER_PWM_M_S
            else:
                drive_m_s = min(pwm + DEAD_ZONE_PWM, 0) * _SPEED_PER_PWM_M_S
            rim_m_s += self._motor_response * (drive_m_s - rim_m_s)
        elif rim_m_s == 0.0:
            return 0.0
        else:
            loss_m_s = FRICTION_M_S2 * self._step_s
            rim_m_s = max(rim_m_s - loss_m_s, 0.0) if rim_m_s > 0.0 else min(rim_m_s + loss_m_s, 0.0)
        if -_STANDING_M_S < rim_m_s < _STANDING_M_S:
            self._rim_m_s[wheel] = 0.0
            return 0.0
        self._rim_m_s[wheel] = rim_m_s
        rolled_m = rim_m_s * self._step_s
        self._rolled_m[wheel] += rolled_m
        if self._slip_sd > 0.0:
            share = min(abs(rolled_m) / SLIP_LENGTH_M, 1.0)
            slip = self._slip[wheel]
            slip += -share * slip + self._rng.gauss(0.0, self._slip_sd * sqrt(2.0 * share))
            self._slip[wheel] = slip
            return rim_m_s * diameter_factor * (1.0 + slip)
        return rim_m_s * diameter_factor * (1.0 + self._slip[wheel])

    def _bump_distance_m(self) -> float:
        spacing_m = self._profile.bump_spacing_m
        return inf if spacing_m == inf else self._rng.expovariate(1.0 / spacing_m)

    def _bump(self, driven_m: float) -> float:
        """Yaw rate that a sill or a cable puts on the body without turning a wheel."""
        self._next_bump_m -= driven_m
        if self._next_bump_m <= 0.0:
            angle_rad = self._rng.uniform(self._profile.bump_min_rad, self._profile.bump_max_rad)
            self._bump_rad_s = self._rng.choice((-1.0, 1.0)) * angle_rad / BUMP_DURATION_S
            self._bump_left_s = BUMP_DURATION_S
            self._next_bump_m = self._bump_distance_m()
        if self._bump_left_s <= 1e-9:
            return 0.0
        self._bump_left_s -= self._step_s
        return self._bump_rad_s
