"""Ties to places visited before: what was driven lately is matched against what was driven here then."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.back_end.factors import Kind
from onboard.mmu.back_end.keyframe_graph import Trail

RECENT_M = 5.0  # of way that is matched as one
LOOP_GAP_M = 12.0  # of way before a place counts as visited before
LOOP_REACH_M = 3.0
LOOP_RIVAL_MAX = 0.9
LOOP_SPAN_M = 7.0
LOOP_OVERLAP_MIN = 0.55
LOOP_RMS_MAX_M = 0.07
LOOP_POINTS_MIN = 25
LOOP_SD_M = 0.07
LOOP_SD_RAD = radians(0.6)
PASSES_MAX = 2


@dataclass(slots=True)
class LoopTies:
    _trail: Trail
    closures: int = 0

    def look(self) -> None:
        """The oldest passes of this place first."""
        rows = self._trail.echoes.stretch(self._trail.way_m - RECENT_M)
        if len(rows) < LOOP_POINTS_MIN:
            return
        poses = self._trail.graph.poses
        here = poses[-1]
        ways = np.array(self._trail.ways_m)
        old = ways < self._trail.way_m - RECENT_M - LOOP_GAP_M
        near = np.hypot(poses[:, 0] - here[0], poses[:, 1] - here[1])
        near[~old] = np.inf
        mine = int(np.median(rows[:, 0]))
        reach_m = LOOP_REACH_M + self._trail.errors.search_window(self._trail.way_m - self._trail.tied_m)[0]
        for _ in range(PASSES_MAX):
            reachable = np.flatnonzero(near < reach_m)
            if not len(reachable):
                return
            first = ways[reachable[0]]
            of_pass = reachable[ways[reachable] < first + 2 * LOOP_REACH_M]
            self._match_pass(int(of_pass[near[of_pass].argmin()]), mine, rows)
            near[ways < first + 2 * LOOP_SPAN_M] = np.inf

    def _match_pass(self, node: int, mine: int, recent: FloatArray) -> None:
        way_m = self._trail.ways_m[node]
        end_m = min(way_m + LOOP_SPAN_M, self._trail.way_m - RECENT_M - 2.0)
        rows = self._trail.echoes.stretch(way_m - LOOP_SPAN_M, end_m)
        if len(rows) < LOOP_POINTS_MIN:
            return
        since_m = self._trail.way_m - self._trail.tied_m
        search_m, search_rad = self._trail.errors.search_window(since_m)
        match = self._trail.register(recent, rows, mine, search_m, search_rad)
        if (
            match is None
            or match.overlap < LOOP_OVERLAP_MIN
            or match.rms_m > LOOP_RMS_MAX_M
            or match.overlap * len(recent) < LOOP_POINTS_MIN
            or match.rival > LOOP_RIVAL_MAX
        ):
            return
        self.closures += 1
        self._trail.graph.edges.append(self._trail.tie(node, mine, match, Kind.LOOP, LOOP_SD_M, LOOP_SD_RAD))
