"""Motors and wheels of the simulated body: PWM -> rotation (what the encoders measure) -> motion over the floor.

Rotation and motion differ by the errors of a run: wheel diameters, track, slip and bumps.
"""

from __future__ import annotations

from ctypes import c_int32
from math import exp, inf, pi, sqrt
from random import Random

from common.constants import ENCODER_TICKS_PER_TURN, WHEEL_DIAMETER_M, WHEEL_TRACK_M
from offboard.simulator.error_profiles import RunErrors
from offboard.simulator.native.library import DriveTrainState, NormalStream, callback, library

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
        profile = errors.profile
        self._profile = profile
        # A random walk of the rolled distance, made smooth: a share of it that changes over SLIP_LENGTH_M
        slip_sd = profile.slip_sd_per_sqrt_m / sqrt(2.0 * SLIP_LENGTH_M)
        self.state = state = DriveTrainState(
            step_s=step_s,
            motor_response=1.0 - exp(-step_s / MOTOR_TIME_CONSTANT_S),
            dead_zone_pwm=DEAD_ZONE_PWM,
            speed_per_pwm_m_s=_SPEED_PER_PWM_M_S,
            friction_m_s2=FRICTION_M_S2,
            standing_m_s=_STANDING_M_S,
            slip_length_m=SLIP_LENGTH_M,
            slip_sd=slip_sd,
            track_m=WHEEL_TRACK_M * errors.track_factor,
            ticks_per_m=ENCODER_TICKS_PER_TURN / (pi * WHEEL_DIAMETER_M),
            diameter_factor=(errors.left_diameter_factor, errors.right_diameter_factor),
            slip=(rng.gauss(0.0, slip_sd), rng.gauss(0.0, slip_sd)),
            bumps=profile.bump_spacing_m != inf,
        )
        state.next_bump_m = self._bump_distance_m(rng)
        self._draw_bump = callback(self._bump)
        state.draw_bump = self._draw_bump
        self._normals = NormalStream(rng, state.normals)
        self._library = library()

    def step(self, pwm_left: int, pwm_right: int, enabled: bool) -> tuple[float, float]:
        """Drives for one step at PWM -255..255; returns speed (m/s) and yaw rate (rad/s) of an unblocked body."""
        self._library.drive_train_step(self.state, pwm_left, pwm_right, enabled)
        return self.state.speed_m_s, self.state.yaw_rate_rad_s

    def edges(self) -> tuple[int, int]:
        """Signed quadrature edges of both encoders since the last call."""
        edges = (c_int32 * 2)()
        self._library.drive_train_edges(self.state, edges)
        return edges[0], edges[1]

    def _bump_distance_m(self, rng: Random) -> float:
        spacing_m = self._profile.bump_spacing_m
        return inf if spacing_m == inf else rng.expovariate(1.0 / spacing_m)

    def _bump(self) -> None:
        """A sill or a cable: a yaw rate of the body that no wheel turns for."""
        rng = self._normals.rewound()
        angle_rad = rng.uniform(self._profile.bump_min_rad, self._profile.bump_max_rad)
        self.state.bump_rad_s = rng.choice((-1.0, 1.0)) * angle_rad / BUMP_DURATION_S
        self.state.bump_left_s = BUMP_DURATION_S
        self.state.next_bump_m = self._bump_distance_m(rng)
