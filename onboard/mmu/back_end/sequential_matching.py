"""Ties of the newest stretch to what was seen a moment ago, where no gyro leads the heading.

1. Do walls seem to turn as the robot drives along them? Then odometry turns: that tells whether a gyro leads it, and
   by how much it turns if none does.
2. Where none does, the newest stretch is registered onto the one before it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import radians

import numpy as np

from common.geometry import Pose2, wrap_angle
from onboard.mmu.back_end.factors import Edge, Kind
from onboard.mmu.back_end.heading_drift import bend
from onboard.mmu.back_end.keyframe_graph import Trail
from onboard.mmu.back_end.odometry_noise import WHEELS_ALONE

BEND_WAY_M = 5.0
BENDS_KEPT = 16
BENDS_MIN = 2
BEND_SD_RAD_PER_M = radians(1.0)  # of one: niches and corners turn
BEND_SIGMAS = 4.0  # walls that together turn by so much: no gyro leads odometry
NEAR_M = 1.5  # of way: the stretch that is registered onto what came before
NEAR_GAP_M = 0.3
NEAR_REACH_M = 12.0
NEAR_POINTS_MIN = 10
NEAR_OVERLAP_MIN = 0.3
NEAR_RMS_MAX_M = 0.07
NEAR_SD_M = 0.05  # neighbouring stretches overlap and say the same
NEAR_SD_RAD = radians(2.0)


@dataclass(slots=True)
class NearTies:
    _trail: Trail
    _bends: deque[float] = field(default_factory=lambda: deque(maxlen=BENDS_KEPT))  # of walls, rad/m
    _bent_m: float = 0.0
    _waiting: deque[Edge] = field(default_factory=lambda: deque(maxlen=BENDS_KEPT))  # for a verdict on odometry

    def look(self) -> None:
        """The newest stretch onto the one before it, where no gyro leads odometry."""
        if self._trail.errors is WHEELS_ALONE:
            while self._waiting:
                self._trail.graph.edges.append(self._waiting.popleft())
            self._tie_newest()

    def judge_odometry(self) -> bool:
        """The newest stretch turned as the walls beside it seem to, the other way round.

        True where that told that no gyro leads odometry.
        """
        if self._trail.way_m - self._bent_m < BEND_WAY_M:
            return False
        rows = self._trail.echoes.stretch(self._bent_m, self._trail.way_m)
        first = int(np.searchsorted(self._trail.ways_m, self._bent_m))
        node, self._bent_m = len(self._trail.frames) - 1, self._trail.way_m
        raw_rad = np.array([f.odom.heading_rad - f.calibrated_rad for f in self._trail.frames])
        bend_rad_per_m = bend(rows[:, 1], rows[:, 4] + raw_rad[rows[:, 0].astype(int)])
        if bend_rad_per_m is None:
            return False
        way_m = self._trail.ways_m[node] - self._trail.ways_m[first]
        here = self._trail.graph.pose(first).between(self._trail.graph.pose(node))
        turned_rad = wrap_angle(raw_rad[node] - raw_rad[first] - bend_rad_per_m * way_m)
        information = np.diag([0.0, 0.0, (BEND_SD_RAD_PER_M * way_m) ** -2])
        self._waiting.append(Edge(first, node, Pose2(here.x_m, here.y_m, turned_rad), information, Kind.NEAR))
        self._bends.append(bend_rad_per_m)
        doubted = self._trail.errors is not WHEELS_ALONE and len(self._bends) >= BENDS_MIN
        if doubted and abs(sum(self._bends)) > BEND_SIGMAS * BEND_SD_RAD_PER_M * len(self._bends) ** 0.5:
            self._trail.distrust_odometry()
            return True
        return False

    def _tie_newest(self) -> None:
        """Register the newest stretch onto the one before it."""
        begins_m = self._trail.way_m - NEAR_M
        mine = self._trail.echoes.stretch(begins_m)
        other = self._trail.echoes.stretch(begins_m - NEAR_REACH_M, begins_m - NEAR_GAP_M)
        if len(mine) < NEAR_POINTS_MIN or len(other) < NEAR_POINTS_MIN:
            return
        node = int(np.median(mine[:, 0]))
        match = self._trail.register(mine, other, node, 0.0, 0.0)
        if match is None or match.overlap < NEAR_OVERLAP_MIN or match.rms_m > NEAR_RMS_MAX_M:
            return
        # Held by the end of the stretch before: that is what it was registered onto, most of all
        anchor = int(np.searchsorted(self._trail.ways_m, begins_m - NEAR_GAP_M - 1.0))
        if anchor >= node:
            return
        self._trail.graph.edges.append(self._trail.tie(anchor, node, match, Kind.NEAR, NEAR_SD_M, NEAR_SD_RAD))
