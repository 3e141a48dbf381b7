"""Errors of the simulated robot: `ErrorProfile` holds their distributions, `draw_run_errors` draws those of one run.

Every cause draws from a random stream of its own, so that one cause never changes the numbers of another. The sizes are
engineering guesses for a hobby robot with an MPU-6050 and MaxBotix sonars; no real robot has been measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, sqrt
from random import Random

import numpy as np


@dataclass(frozen=True, slots=True)
class ErrorProfile:
    """Standard deviations, rates and limits of every cause; zero switches it off."""

    name: str
    # Geometry of the wheels, fixed for a run: what calibration leaves
    diameter_ratio_sd: float = 0.0  # left over right
    diameter_mean_sd: float = 0.0
    track_sd: float = 0.0
    # Wheels on the floor
    slip_sd_per_sqrt_m: float = 0.0  # each wheel
    bump_spacing_m: float = float("inf")  # mean distance between two
    bump_min_rad: float = radians(1.0)
    bump_max_rad: float = radians(1.0)
    # Gyro
    gyro_bias_max_rad_s: float = 0.0  # turn-on, uniform between minus and plus
    gyro_walk_rad_s_sqrt_s: float = 0.0
    gyro_scale_sd: float = 0.0
    gyro_white_rad_s: float = 0.0  # of a sample at 100 Hz
    # Sonars
    sonar_range_sd: float = 0.0  # share of the range
    sonar_gain_sd_db: float = 0.0
    sonar_early: float = 0.0  # probabilities, for one ping
    sonar_cross_talk: float = 0.0
    sonar_loss: float = 0.0
    # Camera
    camera_exposure_s: float = 0.001
    camera_noise_sd: float = 0.0  # of 255
    camera_brightness: float = 0.0  # amplitude of its sine, share of the brightness
    camera_loss: float = 0.0  # share of the frames
    # Serial line
    serial_bit_error_rate: float = 0.0
    serial_stall_s: float = 0.0
    serial_stall_spacing_s: float = float("inf")


PROFILES: dict[str, ErrorProfile] = {
    "none": ErrorProfile("none"),
    "realistic": ErrorProfile(
        "realistic",
        diameter_ratio_sd=0.002,
        diameter_mean_sd=0.003,
        track_sd=0.005,
        slip_sd_per_sqrt_m=0.01,
        bump_spacing_m=30.0,
        bump_max_rad=radians(3.0),
        gyro_bias_max_rad_s=radians(5.0),
        gyro_walk_rad_s_sqrt_s=radians(0.002),
        gyro_scale_sd=0.003,
        gyro_white_rad_s=radians(0.05),
        sonar_range_sd=0.004,
        sonar_gain_sd_db=2.0,
        sonar_early=0.01,
        sonar_cross_talk=0.05,
        sonar_loss=0.02,
        camera_exposure_s=0.015,
        camera_noise_sd=3.0,
        camera_brightness=0.2,
        camera_loss=0.01,
        serial_bit_error_rate=1e-7,
    ),
    "harsh": ErrorProfile(
        "harsh",
        diameter_ratio_sd=0.006,
        diameter_mean_sd=0.01,
        track_sd=0.02,
        slip_sd_per_sqrt_m=0.03,
        bump_spacing_m=10.0,
        bump_max_rad=radians(5.0),
        gyro_bias_max_rad_s=radians(20.0),
        gyro_walk_rad_s_sqrt_s=radians(0.006),
        gyro_scale_sd=0.01,
        gyro_white_rad_s=radians(0.15),
        sonar_range_sd=0.01,
        sonar_gain_sd_db=2.0,
        sonar_early=0.03,
        sonar_cross_talk=0.2,
        sonar_loss=0.1,
        camera_exposure_s=0.03,
        camera_noise_sd=8.0,
        camera_brightness=0.5,
        camera_loss=0.05,
        serial_bit_error_rate=1e-5,
        serial_stall_s=0.2,
        serial_stall_spacing_s=60.0,
    ),
}

_STREAMS = ("run", "slip", "gyro", "sonar", "camera", "serial", "plates")


@dataclass(frozen=True, slots=True)
class RunErrors:
    """Errors that stay the same for a whole run."""

    profile: ErrorProfile
    left_diameter_factor: float  # true over nominal
    right_diameter_factor: float
    track_factor: float
    gyro_bias_rad_s: tuple[float, float, float]  # x, y, z at power-on
    gyro_scale_factor: float  # measured over true
    brightness_phase_rad: float


def random_stream(seed: int, name: str) -> Random:
    """The random numbers of one cause: a plain Random, since scalars from numpy cost four times as much."""
    spawned = np.random.SeedSequence(seed).spawn(len(_STREAMS))[_STREAMS.index(name)]
    return Random(int.from_bytes(spawned.generate_state(4).tobytes(), "little"))


def draw_run_errors(profile: ErrorProfile, seed: int) -> RunErrors:
    """The errors of the run with this seed."""
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(len(_STREAMS))[_STREAMS.index("run")])
    mean = 1.0 + profile.diameter_mean_sd * rng.standard_normal()
    ratio_root = sqrt(1.0 + profile.diameter_ratio_sd * rng.standard_normal())
    bias = profile.gyro_bias_max_rad_s * rng.uniform(-1.0, 1.0, 3)
    return RunErrors(
        profile=profile,
        left_diameter_factor=float(mean * ratio_root),
        right_diameter_factor=float(mean / ratio_root),
        track_factor=float(1.0 + profile.track_sd * rng.standard_normal()),
        gyro_bias_rad_s=(float(bias[0]), float(bias[1]), float(bias[2])),
        gyro_scale_factor=float(1.0 + profile.gyro_scale_sd * rng.standard_normal()),
        brightness_phase_rad=float(rng.uniform(0.0, 2.0 * np.pi)),
    )
