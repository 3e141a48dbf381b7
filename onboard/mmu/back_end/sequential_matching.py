"""Sequential scan matching: constraints of the newest stretch to what was observed a moment ago, without a gyro.

1. Do walls seem to turn as the robot drives along them? Then odometry turns: that shows whether a gyro leads it, and by
   how much it turns if none does.
2. Where none does, the newest stretch is registered onto the one before it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians, sqrt

import numpy as np

from common.geometry import wrap_angle
from onboard.mmu.back_end.heading_drift import apparent_turn
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.odometry_noise import WHEELS_ALONE

# Tuned on recorded robots (range logs), some of whose wheels lead the heading alone. The sensitivity was not measured
TURN_PATH_M = 5.0  # over which the apparent turn of walls is measured
TURNS_KEPT = 16
TURNS_MIN = 2
TURNS_PRIOR = 2  # measurements that the standard deviation below counts for
TURN_SD_RAD_PER_M = radians(1.0)  # of one measurement at least: niches and corners turn, more so where much stands
TURN_SIGMAS = 4.0  # walls that together seem to turn by this much: no gyro leads odometry
STRETCH_M = 1.5  # of path that is registered onto what came before
GAP_M = 0.3
REACH_M = 12.0
POINTS_MIN = 10
OVERLAP_MIN = 0.3
RMS_MAX_M = 0.07
MATCH_SD_M = 0.05  # neighbouring stretches overlap and measure the same twice
MATCH_SD_RAD = radians(2.0)


def _scatter(turns: Sequence[float]) -> float:
    """Standard deviation of one measurement of the turn, rad/m: TURN_SD_RAD_PER_M until these show another."""
    mean = sum(turns) / len(turns)
    squares = sum((turn - mean) ** 2 for turn in turns) + TURNS_PRIOR * TURN_SD_RAD_PER_M**2
    return max(TURN_SD_RAD_PER_M, sqrt(squares / (len(turns) - 1 + TURNS_PRIOR)))


@dataclass(slots=True)
class SequentialMatching:
    _keyframes: KeyframeGraph
    _turns: deque[float] = field(default_factory=lambda: deque(maxlen=TURNS_KEPT))  # of walls, rad/m
    _measured_m: float = 0.0  # path up to which the turn of walls was measured

    def match_newest(self) -> None:
        """Registers the newest stretch onto the one before it, where no gyro leads odometry."""
        if self._keyframes.noise is WHEELS_ALONE:
            self._register_newest()

    @property
    def walls_turn(self) -> bool:
        """As the robot drives along them, by more than chance: no gyro leads odometry."""
        turns = self._turns
        return len(turns) >= TURNS_MIN and abs(sum(turns)) > TURN_SIGMAS * _scatter(turns) * len(turns) ** 0.5

    def measure_turn(self) -> None:
        """The newest one: the robot turned as the walls beside it seem to, the other way round."""
        keyframes = self._keyframes
        if keyframes.path_m - self._measured_m < TURN_PATH_M:
            return
        rows = keyframes.echoes.stretch(self._measured_m, keyframes.path_m)
        first = int(np.searchsorted(keyframes.paths_m, self._measured_m))
        node, self._measured_m = len(keyframes) - 1, keyframes.path_m
        raw_rad = keyframes.measured_headings_rad
        turn_rad_per_m = apparent_turn(rows[:, 1], rows[:, 4] + raw_rad[rows[:, 0].astype(int)])
        if turn_rad_per_m is None:
            return
        self._turns.append(turn_rad_per_m)
        if keyframes.noise is not WHEELS_ALONE:
            return
        path_m = keyframes.paths_m[node] - keyframes.paths_m[first]
        turn_rad = wrap_angle(raw_rad[node] - raw_rad[first] - turn_rad_per_m * path_m)
        keyframes.graph.heading_changes.add(first, node, turn_rad, TURN_SD_RAD_PER_M * path_m)

    def _register_newest(self) -> None:
        keyframes = self._keyframes
        begins_m = keyframes.path_m - STRETCH_M
        mine = keyframes.echoes.stretch(begins_m)
        other = keyframes.echoes.stretch(begins_m - REACH_M, begins_m - GAP_M)
        if len(mine) < POINTS_MIN or len(other) < POINTS_MIN:
            return
        node = int(np.median(mine[:, 0]))
        match = keyframes.register(mine, other, node, 0.0, 0.0)
        if match is None or match.overlap < OVERLAP_MIN or match.rms_m > RMS_MAX_M:
            return
        # Held by the end of the stretch before: that is what it was registered onto, most of all
        anchor = int(np.searchsorted(keyframes.paths_m, begins_m - GAP_M - 1.0))
        if anchor >= node:
            return
        measured = keyframes.measured(anchor, node, match, MATCH_SD_M, MATCH_SD_RAD)
        keyframes.graph.sequential_matches.add(anchor, node, *measured)
