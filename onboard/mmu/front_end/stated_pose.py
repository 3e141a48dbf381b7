"""A pose that a person states (ROS: initial pose): can it be used, and what do the sonars say to it?

A robot that was carried has nothing but the ranges of the place where it stands now. A range is explained at a pose
where the map has a wall in that beam, so far away. The stated pose is refused where the present one explains more of
them than any within two standard deviations of the stated one: then the robot stands where it believes to be.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from common.geometry import FloatArray, Points, Pose2, wrap_angles

NEAR_M = 3.0  # from where the robot drove: further away no loop closure would look for it (`loop_closure.REACH_M`)
SD_MAX_M = 1.0  # twice as much is what a loop closure's search reaches at most, with some room
SD_MIN_M, SD_MIN_RAD = 0.05, 0.02  # nobody knows it better
# The sensitivity to these was not measured
RANGE_MAX_M = 3.0  # longer ones are echoes of anything
RANGE_SD_M = 0.15
CELL_M = 0.1
STEPS = np.linspace(-2.0, 2.0, 5)  # standard deviations


@dataclass(frozen=True, slots=True)
class Beams:
    """The newest ranges (m, NaN where nothing answered), with the beams' bearings and half width."""

    ranges_m: tuple[float, ...]
    bearings_rad: tuple[float, ...]
    half_rad: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """`note`: the reason of a refusal, else what the sonars say to it; a sentence for a person."""

    refused: bool
    note: str


def judge(
    stated: Pose2, sd_m: float, sd_rad: float, present: Pose2 | None, apart_m: float, beams: Beams, walls: Points
) -> Verdict:
    """`present`: where the robot believes to be, None where it does not know; `apart_m`: from the stated place to the
    nearest keyframe; `walls` (N, 2): of the map.
    """
    if not len(walls):
        return Verdict(True, "The map begins where the robot stands: nothing is in it yet to stand beside.")
    if apart_m > NEAR_M:
        return Verdict(True, f"No part of the map that the robot drove is within {NEAR_M:.0f} m of that place.")
    if sd_m > SD_MAX_M:
        return Verdict(True, f"A place that is known to {sd_m:.1f} m is of no use: {SD_MAX_M:.0f} m at most.")
    echoes = [
        (range_m, bearing_rad)
        for range_m, bearing_rad in zip(beams.ranges_m, beams.bearings_rad, strict=True)
        if isfinite(range_m) and range_m < RANGE_MAX_M
    ]
    x, y, turn = np.meshgrid(sd_m * STEPS, sd_m * STEPS, sd_rad * STEPS, indexing="ij")
    offsets = np.column_stack([x.ravel(), y.ravel(), turn.ravel()])
    tolerance_m = RANGE_SD_M + sd_m / 2  # half way to the next of these poses
    there = _explained(stated.as_array() + offsets, echoes, beams.half_rad, walls, tolerance_m)
    here = 0 if present is None else _explained(present.as_array()[None], echoes, beams.half_rad, walls, tolerance_m)
    found = f"{there} of {len(echoes)} sonars with an echo show a wall of the map there"
    if here > there:
        return Verdict(True, f"The robot does not stand there: {found}, {here} where it believes to be.")
    return Verdict(False, f"{found[0].upper()}{found[1:]}." if echoes else "No sonar has an echo to compare.")


def _explained(
    poses: FloatArray, echoes: list[tuple[float, float]], half_rad: float, walls: Points, tolerance_m: float
) -> int:
    """How many of the echoes (range, bearing) the best of the poses (P, 3) explains."""
    reach_m = RANGE_MAX_M + tolerance_m + float(np.abs(poses[:, :2] - poses[0, :2]).max())
    near = walls[np.abs(walls - poses[:, :2].mean(axis=0)).max(axis=1) < reach_m]
    near = CELL_M * np.unique(np.round(near / CELL_M), axis=0)
    dx, dy = near[None, :, 0] - poses[:, :1], near[None, :, 1] - poses[:, 1:2]
    distance_m, bearing_rad = np.hypot(dx, dy), np.arctan2(dy, dx) - poses[:, 2:]
    explained = np.zeros(len(poses), dtype=int)
    for range_m, beam_rad in echoes:
        in_beam = np.abs(wrap_angles(bearing_rad - beam_rad)) < half_rad
        explained += (in_beam & (np.abs(distance_m - range_m) < tolerance_m)).any(axis=1)
    return int(explained.max())
