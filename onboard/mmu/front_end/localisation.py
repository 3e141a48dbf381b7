"""Uncertainty of the robot's pose in the map."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from math import degrees, inf, pi, radians

# Standard deviations at a loop closure, and how they grow with the path. They decide whether the pose is valid, and
# nothing else; the sensitivity was not measured
SD_M = 0.03
SD_M_PER_M = 0.01
SD_MAX_M = 2.5
SD_RAD = radians(0.3)
SD_RAD_PER_M = radians(0.05)

_log = logging.getLogger("mmu")


@dataclass(slots=True)
class Localisation:
    """By the path since the last loop closure, and by whether the robot may have been kidnapped since."""

    kidnapped: bool = False
    _known_path_m: float = 0.0  # path at which it was known as well as `_known`: the newest loop closure, as a rule
    _known: tuple[float, float] = (SD_M, SD_RAD)
    _since_m: float = 0.0  # path after which a loop closure shows where the robot is now

    def begin_at(self, path_m: float) -> None:
        """Loop closures up to that path show nothing about where the robot is now."""
        self._since_m = self._known_path_m = path_m

    def kidnap(self, path_m: float) -> None:
        """The robot may have been carried elsewhere (kidnapped robot problem)."""
        self.kidnapped = True
        self.begin_at(path_m)
        _log.info("position unknown path_m=%.1f: the robot is searched for in the map", path_m)

    def place(self, path_m: float, sd_m: float, sd_rad: float) -> None:
        """A person says where the robot stands; that and how well is all that is known of it."""
        self.kidnapped, self._known = False, (sd_m, sd_rad)
        self.begin_at(path_m)
        _log.info("position stated path_m=%.1f sd_m=%.2f sd_deg=%.0f", path_m, sd_m, degrees(sd_rad))

    def close(self, closure_path_m: float) -> None:
        """The path at the newest loop closure that was adopted so far."""
        if closure_path_m <= self._since_m:
            return
        self._known_path_m, self._known = closure_path_m, (SD_M, SD_RAD)
        if self.kidnapped:
            self.kidnapped = False
            _log.info("position found in the map path_m=%.1f", closure_path_m)

    def uncertainty(self, path_m: float) -> tuple[float, float]:
        """Standard deviations of position (metres) and heading (radians)."""
        if self.kidnapped:
            return inf, pi
        since_m, (sd_m, sd_rad) = path_m - self._known_path_m, self._known
        return min(sd_m + SD_M_PER_M * since_m, SD_MAX_M), sd_rad + SD_RAD_PER_M * since_m
