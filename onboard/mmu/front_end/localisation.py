"""Uncertainty of the robot's pose in the map."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from math import inf, pi, radians

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

    closure_path_m: float = 0.0  # path at the newest loop closure that was adopted
    kidnapped: bool = False
    _since_m: float = 0.0  # path after which a loop closure shows where a kidnapped robot is

    def begin_at(self, path_m: float) -> None:
        """Loop closures up to that path show nothing about where the robot is now."""
        self._since_m = path_m

    def kidnap(self, path_m: float) -> None:
        """The robot may have been carried elsewhere (kidnapped robot problem)."""
        self.kidnapped = True
        self.begin_at(path_m)
        _log.info("position unknown path_m=%.1f: the robot is searched for in the map", path_m)

    def close(self, closure_path_m: float) -> None:
        """The newest loop closure that was adopted so far."""
        self.closure_path_m = closure_path_m
        if self.kidnapped and closure_path_m > self._since_m:
            self.kidnapped = False
            _log.info("position found in the map path_m=%.1f", closure_path_m)

    def uncertainty(self, path_m: float) -> tuple[float, float]:
        """Standard deviations of position (metres) and heading (radians)."""
        if self.kidnapped:
            return inf, pi
        since_m = path_m - self.closure_path_m
        return min(SD_M + SD_M_PER_M * since_m, SD_MAX_M), SD_RAD + SD_RAD_PER_M * since_m
