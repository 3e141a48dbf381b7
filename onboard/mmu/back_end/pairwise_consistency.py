"""Pairwise consistency of loop closures (Mangelson et al. 2018): several that say the same are believed.

Where a match is weak, or the robot might be anywhere, what it says proves nothing, for halls look alike. But what is
wrong differs from one stretch of the path to the next, and what is right does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.closure_attempt import Attempt
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph

# Chosen on one log of wheels alone, and the same on all others. The sensitivity was not measured
HELD_M = 15.0  # of path; older ones are let go
AGREE_MIN = 3
APART_MIN_M = 5.0  # of path, from the first of them to the last: they share no echoes


@dataclass(frozen=True, slots=True)
class Candidate:
    """The node as seen from the anchor, and its information (3, 3) in the anchor's frame."""

    attempt: Attempt
    seen: Pose2
    information: FloatArray


class Candidates:
    """Matches that are not believed yet; `agreeing` takes out those that are now."""

    def __init__(self, keyframes: KeyframeGraph) -> None:
        self._keyframes = keyframes
        self._held: list[Candidate] = []

    def hold(self, candidate: Candidate) -> None:
        oldest_m = self._keyframes.path_m - HELD_M
        self._held = [held for held in self._held if self._keyframes.paths_m[held.attempt.node] >= oldest_m]
        self._held.append(candidate)

    def clear(self) -> None:
        """A match that passes all gates says it better than these."""
        self._held = []

    def agreeing(self) -> list[Candidate]:
        """The newest one and all that agree with it, if they are enough; otherwise none."""
        newest = self._held[-1]
        paths_m = self._keyframes.paths_m
        agreed = [held for held in self._held if self._agree(held, newest)]
        if len(agreed) < AGREE_MIN or paths_m[newest.attempt.node] - paths_m[agreed[0].attempt.node] < APART_MIN_M:
            return []
        self._held = []
        return agreed

    def _agree(self, one: Candidate, other: Candidate) -> bool:
        """Do both place the robot alike, but for what odometry loses on the paths between them?"""
        graph, paths_m = self._keyframes.graph, self._keyframes.paths_m
        first, second = one.attempt, other.attempt
        driven = graph.pose(first.node).between(graph.pose(second.node))
        expected = graph.pose(first.anchor).compose(one.seen).compose(driven)
        off = expected.between(graph.pose(second.anchor).compose(other.seen))
        anchors_m = abs(paths_m[first.anchor] - paths_m[second.anchor])
        between_m = abs(paths_m[first.node] - paths_m[second.node]) + anchors_m
        may_m, may_rad = self._keyframes.noise.search_window(between_m)
        return bool(hypot(off.x_m, off.y_m) <= may_m and abs(off.heading_rad) <= may_rad)
