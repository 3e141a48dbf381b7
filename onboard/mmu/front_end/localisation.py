"""Uncertainty of the robot's pose in the map."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from math import degrees, inf, pi, radians, sqrt

import numpy as np

from common.geometry import FloatArray, principal_axes

# Standard deviations after a restart, until the back end knows better; how they grow with the path that it does not
# know yet, which is a metre as a rule. The sensitivity was not measured
SD_M = 0.03
SD_M_PER_M = 0.01
SD_MAX_M = 2.5
SD_RAD = radians(0.3)
SD_RAD_PER_M = radians(0.05)

_log = logging.getLogger("mmu")


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Standard deviations of the position (m), in its worst direction, which is `worst_rad` on the map, and at right
    angles to it; and of the heading (rad).
    """

    sd_m: float
    sd_least_m: float
    worst_rad: float
    sd_heading_rad: float


NOTHING_KNOWN = Uncertainty(inf, inf, 0.0, pi)


@dataclass(slots=True)
class Localisation:
    """By the covariance of the newest keyframe that the back end has, and by whether the robot may have been kidnapped
    since.
    """

    kidnapped: bool = False
    _covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    _known_path_m: float = 0.0  # path at that keyframe
    _since_m: float = 0.0  # path after which a loop closure shows where the robot is now
    _since_node: int = 0  # keyframe before which nothing is known of where it is now

    def begin_at(self, path_m: float) -> None:
        """Loop closures up to that path show nothing about where the robot is now."""
        self._since_m = path_m
        self._set(path_m, SD_M, SD_RAD)

    def kidnap(self, path_m: float) -> None:
        """The robot may have been carried elsewhere (kidnapped robot problem)."""
        self.kidnapped = True
        self._since_m = path_m
        _log.info("position unknown path_m=%.1f: the robot is searched for in the map", path_m)

    def place(self, path_m: float, node: int, sd_m: float, sd_rad: float) -> None:
        """A person says where the robot stands, at a new keyframe; that and how well is all that is known of it."""
        self.kidnapped, self._since_m, self._since_node = False, path_m, node
        self._set(path_m, sd_m, sd_rad)
        _log.info("position stated path_m=%.1f sd_m=%.2f sd_deg=%.0f", path_m, sd_m, degrees(sd_rad))

    def correct(self, covariance: FloatArray, node: int, path_m: float, closure_path_m: float) -> None:
        """By the back end: covariance (3, 3) of that keyframe, at that path; the path at the newest loop closure."""
        if self.kidnapped and closure_path_m > self._since_m:
            self.kidnapped = False
            _log.info("position found in the map path_m=%.1f", closure_path_m)
        if node >= self._since_node:
            self._covariance, self._known_path_m = covariance, path_m

    def uncertainty(self, path_m: float) -> Uncertainty:
        if self.kidnapped:
            return NOTHING_KNOWN
        since_m = path_m - self._known_path_m
        (xx, xy, _), (_, yy, _), (_, _, heading) = self._covariance.tolist()
        *variances, worst_rad = principal_axes(xx, xy, yy)
        worst_m, least_m = (min(sqrt(max(variance, 0.0)) + SD_M_PER_M * since_m, SD_MAX_M) for variance in variances)
        heading_rad = sqrt(max(heading, 0.0)) + SD_RAD_PER_M * since_m
        return Uncertainty(worst_m, least_m, worst_rad, min(heading_rad, pi))

    def _set(self, path_m: float, sd_m: float, sd_rad: float) -> None:
        self._covariance, self._known_path_m = np.diag([sd_m**2, sd_m**2, sd_rad**2]), path_m
