"""The back end: key frames and echoes in, corrected poses of all of them out. Runs beside the mapping unit's steps.

1. Odometry joins the key frames in the pose graph (`keyframe_graph`).
2. Ties are looked for: `sequential_matching`, `wall_factors`, `loop_closure`.
3. The graph comes to rest when it gained a tie that pulls.
"""

from __future__ import annotations

from onboard.mmu.back_end.factors import Kind
from onboard.mmu.back_end.keyframe_graph import Trail
from onboard.mmu.back_end.loop_closure import LoopTies
from onboard.mmu.back_end.odometry_noise import GYRO_LED, UNKNOWN
from onboard.mmu.back_end.pose_graph import TURN
from onboard.mmu.back_end.sequential_matching import NearTies
from onboard.mmu.back_end.wall_factors import WallTies
from onboard.mmu.map.keyframes import Correction, FrameStore, Increment

MATCH_EVERY_M = 1.0
STRAIN_MAX = 0.5  # a new tie that pulls less (chi squared) can wait
ADOPTED_CHI2 = 12.0  # a closure that the graph at rest pulls at more was not believed


class BackEnd:
    """`gyro_led` false: it is not known whether a gyro leads odometry's heading, and found out from the walls."""

    def __init__(self, gyro_led: bool = True) -> None:
        self._trail = Trail(GYRO_LED if gyro_led else UNKNOWN)
        self._near = None if gyro_led else NearTies(self._trail)
        self._walls, self._loops = WallTies(self._trail), LoopTies(self._trail)
        self._matched_m = 0.0

    @property
    def echoes(self) -> FrameStore:
        """All that were taken in."""
        return self._trail.echoes

    def take(self, increment: Increment) -> Correction:
        """One round of work on what is new."""
        trail = self._trail
        for frame in increment.frames:
            trail.add_frame(frame, increment.known)
        trail.echoes.append(increment.echoes)
        if increment.known:
            self._matched_m = trail.tied_m = trail.way_m
        elif trail.frames:
            self._tie(increment)
        slow = trail.graph.slow
        drift = float(slow[-1]), float(slow[TURN])
        return Correction(trail.graph.poses, drift, self._loops.closures, trail.tied_m)

    def _tie(self, increment: Increment) -> None:
        """Look for ties of what is new to what is known, and let the graph come to rest."""
        if self._near is not None and self._near.judge_odometry():
            self._walls = WallTies(self._trail)
        before = len(self._trail.graph.edges)
        self._walls.look_ahead(increment.approaches)
        if self._near is not None:
            self._near.look()
        before = self._rest(before)
        if self._trail.way_m - self._matched_m >= MATCH_EVERY_M:
            self._matched_m = self._trail.way_m
            self._walls.look_beside()
            self._loops.look()
            self._rest(before)

    def _rest(self, before: int) -> int:
        """Once all edges from the `before`-th on are in; returns how many edges there are."""
        graph = self._trail.graph
        strain = graph.strain(before)
        if strain.max(initial=0.0) > STRAIN_MAX:
            graph.optimise(before)
            strain = graph.strain(before)
        loops = graph.edges.of_kind(Kind.LOOP)[before:]
        if (strain[loops] < ADOPTED_CHI2).any():
            self._trail.tied_m = self._trail.way_m
        return len(graph.edges)
