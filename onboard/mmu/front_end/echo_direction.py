"""Where in the beam did the wall echo? Samples of one thing along the path -> its direction and normal.

A wall echoes in a beam of half width w at its perpendicular foot when the foot lies in the beam, else (a narrow beam, a
laser) where the beam's nearer edge meets it. So, for a wall with normal n at distance d from the robot and a
beam that looks along b:

    range * cos(max(|n - b| - w, 0)) = d

1. For every normal in question, that predicts d from each sample; with the path driven in between, all samples must
   agree. Cross-talk, early echoes and the end of a wall do not fit, and are recognised by that.
2. The spread of the normals that fit shows how well the direction is known: to a degree where the robot drives past;
   where it turns on the spot it is the middle of the headings at which the wall echoes (regions of constant depth:
   Leonard and Durrant-Whyte 1992).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, radians, sqrt

import numpy as np

from common.geometry import FloatArray

# The sensitivity to these was not measured
ANGLE_STEP_RAD = radians(3.0)
NARROW_RAD = radians(20.0)  # in a narrower beam walls echo too that it does not meet squarely
INCIDENCE_MAX_RAD = radians(60.0)
FIT_SD_MAX_M = 0.03
RANGE_SD_SHARE = 0.005
SHARP_RAD = radians(4.0)
AMBIGUOUS_RAD = radians(20.0)
AMBIGUOUS_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class EchoDirection:
    """All angles relative to the beam's axis at the sample in question, radians, left positive."""

    normal_rad: float  # of the wall, away from the robot
    normal_sd_rad: float
    direction_rad: float  # from the robot to the place that echoed
    range_m: float
    fit_sd_m: float


@dataclass(frozen=True, slots=True)
class Beam:
    """A sonar's half width, and the step of its ranges."""

    half_width_rad: float
    step_m: float

    @property
    def narrow(self) -> bool:
        return self.half_width_rad < NARROW_RAD

    def normals(self) -> FloatArray:
        """Normals of walls that may echo in this beam, relative to its axis (A,), and one beyond on each side."""
        reach = max(self.half_width_rad, INCIDENCE_MAX_RAD if self.narrow else 0.0)
        count = round(reach / ANGLE_STEP_RAD) + 1
        return ANGLE_STEP_RAD * np.arange(-count, count + 1, dtype=np.float64)


def locate(
    beam: Beam, normals: FloatArray, at_m: FloatArray, turned_rad: FloatArray, ranges_m: FloatArray, centre: int
) -> EchoDirection | None:
    """Where the wall of the `centre`-th sample echoed, or None where the samples do not agree on one.

    `at_m` (N, 2) and `turned_rad` (N,) are the sonar's places and turns relative to the centre's, in the frame of its
    axis; `normals` is `beam.normals()`.
    """
    count = len(ranges_m)
    off = np.abs(normals[:, None] - turned_rad)
    beyond = np.maximum(off - beam.half_width_rad, 0.0)
    c, s = np.cos(normals), np.sin(normals)
    distance = ranges_m * np.cos(beyond) + c[:, None] * at_m[:, 0] + s[:, None] * at_m[:, 1]
    mean = np.add.reduce(distance, axis=1) / count
    square = np.add.reduce((distance - mean[:, None]) ** 2, axis=1)
    sigma_m = max(beam.step_m / sqrt(12.0), 0.01, RANGE_SD_SHARE * float(ranges_m[centre]))
    limit_rad = max(beam.half_width_rad + 1.5 * ANGLE_STEP_RAD, INCIDENCE_MAX_RAD if beam.narrow else 0.0)
    chi2 = square / sigma_m**2
    chi2[np.maximum.reduce(off, axis=1) > limit_rad] = inf  # out of the beam
    best = int(chi2.argmin())
    fit_sd_m = sqrt(float(square[best]) / max(count - 2, 1))
    at_rim = best in (0, len(normals) - 1)  # what echoed lies outside of the beam
    if fit_sd_m > FIT_SD_MAX_M or at_rim or not isfinite(chi2[best]):
        return None
    found = _peak(normals, chi2, best, np.add.reduce(off, axis=1) / count / max(beam.half_width_rad, NARROW_RAD))
    if found is None:
        return None
    normal_rad, sd_rad = found
    direction_rad = min(max(normal_rad, -beam.half_width_rad), beam.half_width_rad)
    # The mean over the samples is steadier than the one range
    range_m = float(np.interp(normal_rad, normals, mean)) / float(np.cos(normal_rad - direction_rad))
    return EchoDirection(normal_rad, sd_rad, direction_rad, range_m, fit_sd_m / sqrt(count))


def _peak(normals: FloatArray, chi2: FloatArray, best: int, off_axis: FloatArray) -> tuple[float, float] | None:
    """The normal that fits best and its standard deviation; None where two that lie apart fit alike."""
    likely = np.exp(-0.5 * (chi2 - chi2[best] + 2.0 * off_axis**2))
    far = np.abs(normals - normals[best]) > AMBIGUOUS_RAD
    total = float(np.add.reduce(likely))
    if float(np.add.reduce(likely[far])) > AMBIGUOUS_SHARE * total:
        return None
    mean = float(np.add.reduce(likely * normals)) / total
    sd = sqrt(float(np.add.reduce(likely * (normals - mean) ** 2)) / total)
    if sd < SHARP_RAD and 0 < best < len(normals) - 1:
        before, here, after = chi2[best - 1 : best + 2].tolist()
        bend = before - 2 * here + after
        if 0 < bend < inf:
            shift = min(max(0.5 * (before - after) / bend, -1.0), 1.0)
            return float(normals[best]) + shift * ANGLE_STEP_RAD, ANGLE_STEP_RAD * sqrt(2.0 / bend)
    return mean, max(sd, ANGLE_STEP_RAD / 4)
