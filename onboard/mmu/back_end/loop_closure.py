"""Loop closure: what was driven lately is matched against what was driven at the same place before.

Every loop closure that is tried passes its gates here or is rejected: first those of the scan match, then, once the
graph has settled with it, that of its chi-squared. `take_log` reports each with its figures.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import radians

import numpy as np

from common.geometry import FloatArray
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.front_end.scan_matching import Match

# Where a loop closure is tried. The sensitivity to these lengths was not measured
RECENT_M = 5.0  # of path that is matched as one
RECENT_MAX_M = 12.0  # where fewer echoes than these were received in it
RECENT_POINTS = 60
GAP_M = 12.0  # of path before a place counts as visited before
REACH_M = 3.0
SPAN_M = 7.0  # of the earlier path, before and after the place; longer by as much as what is matched is
PASSES_MAX = 2

# Gates. Tuned on recorded robots (range logs); how the share of wrong closures depends on each value was not measured
OVERLAP_MIN = 0.55
RMS_MAX_M = 0.07
POINTS_MIN = 25
AMBIGUITY_MAX = 0.9  # score of the second-best place over that of the best
ADOPTED_CHI2_MAX = 12.0  # at rest; a larger one means that the graph does not agree. (99.3 % of right ones, 3 dof)

# Loop closures that odometry's noise allows pass the last gate, but for wrong ones. Logs of wheels with a gyro lost at
# most four of any ten, three of them in a row; one of wheels alone eight in a row
JUDGED = 8
CONTRADICTED_MIN = 6  # of the newest ones judged

# A match is trusted no further than the sonars' systematic errors
MATCH_SD_M = 0.07
MATCH_SD_RAD = radians(0.6)


@dataclass(frozen=True, slots=True)
class Attempt:
    """A loop closure that was tried between the nodes `anchor` and `node`."""

    anchor: int
    node: int
    points: int  # that were matched
    match: Match | None

    @property
    def failed_gate(self) -> str | None:
        """The first gate of the scan match that it does not pass; None where it passes all."""
        match = self.match
        if match is None:
            return "no match"
        gates = {
            "overlap": match.overlap < OVERLAP_MIN,
            "rms": match.rms_m > RMS_MAX_M,
            "points": match.overlap * self.points < POINTS_MIN,
            "ambiguous": match.ambiguity > AMBIGUITY_MAX,
        }
        return next((name for name, failed in gates.items() if failed), None)

    def line(self, verdict: str, chi2: float | None = None) -> str:
        """One line for the log: each figure beside its gate."""
        text = f"loop closure {verdict} anchor={self.anchor} node={self.node}"
        if self.match is not None:
            text += (
                f" overlap={self.match.overlap:.2f} (min {OVERLAP_MIN:g})"
                f" rms_m={self.match.rms_m:.3f} (max {RMS_MAX_M:g})"
                f" points={self.match.overlap * self.points:.0f} (min {POINTS_MIN})"
                f" ambiguity={self.match.ambiguity:.2f} (max {AMBIGUITY_MAX:g})"
            )
        return text if chi2 is None else f"{text} chi2={chi2:.1f} (max {ADOPTED_CHI2_MAX:g})"


class LoopClosure:
    """`search` adds loop closures to the graph; `adopt`, once the graph has settled, judges those that were added."""

    def __init__(self, keyframes: KeyframeGraph) -> None:
        self.count = 0  # of those that were added
        self._keyframes = keyframes
        self._added: list[Attempt] = []  # and not judged yet
        self._judged: deque[bool] = deque(maxlen=JUDGED)  # whether each was adopted
        self._log: list[str] = []  # two lines at most for each search

    def search(self) -> None:
        """Tries the earlier passes of this place, the oldest ones first."""
        keyframes = self._keyframes
        rows = keyframes.echoes.newest(keyframes.path_m, RECENT_M, RECENT_MAX_M, RECENT_POINTS)
        if len(rows) < POINTS_MIN:
            return
        poses = keyframes.graph.poses
        here = poses[-1]
        paths_m = np.array(keyframes.paths_m)
        begins_m = float(rows[:, 1].min())
        span_m = SPAN_M + max(0.0, keyframes.path_m - begins_m - RECENT_M)
        old = paths_m < begins_m - GAP_M
        near_m = np.hypot(poses[:, 0] - here[0], poses[:, 1] - here[1])
        near_m[~old] = np.inf
        mine = int(np.median(rows[:, 0]))
        graph_paths_m = keyframes.graph_paths_m()
        reach_m = REACH_M + keyframes.noise.search_window(graph_paths_m)[0]
        for _ in range(PASSES_MAX):
            reachable = np.flatnonzero(near_m < reach_m)
            if not len(reachable):
                return
            first_m = paths_m[reachable[0]]
            of_pass = reachable[paths_m[reachable] < first_m + 2 * REACH_M]
            anchor = int(of_pass[near_m[of_pass].argmin()])
            self._try_pass(anchor, mine, rows, span_m, float(graph_paths_m[anchor]))
            near_m[paths_m < first_m + 2 * span_m] = np.inf

    def adopt(self) -> None:
        """Judges the loop closures added since the last call: does the settled graph agree with them?"""
        factors = self._keyframes.graph.loop_closures
        chi2 = factors.chi2_since(self._keyframes.graph.states, len(factors) - len(self._added)).tolist()
        adopted = [own < ADOPTED_CHI2_MAX for own in chi2]
        for attempt, own, good in zip(self._added, chi2, adopted, strict=True):
            self._log.append(attempt.line("adopted" if good else "rejected: chi2", own))
            if good:
                self._keyframes.close_loop(attempt.anchor, attempt.node)
        self._added = []
        self._judged += adopted

    @property
    def contradicted(self) -> bool:
        """The graph agrees with few of the newest loop closures: odometry is worse than its noise says."""
        return self._judged.count(False) >= CONTRADICTED_MIN

    def take_log(self) -> tuple[str, ...]:
        """A line for each loop closure that was tried since the last call."""
        lines, self._log = tuple(self._log), []
        return lines

    def _try_pass(self, anchor: int, node: int, recent: FloatArray, span_m: float, graph_path_m: float) -> None:
        """`span_m`: of path before and after the anchor; `graph_path_m`: from there to here (`graph_paths_m`)."""
        keyframes = self._keyframes
        path_m = keyframes.paths_m[anchor]
        end_m = min(path_m + span_m, float(recent[:, 1].min()) - 2.0)
        rows = keyframes.echoes.stretch(path_m - span_m, end_m)
        if len(rows) < POINTS_MIN:
            return
        search_m, search_rad = keyframes.noise.search_window(graph_path_m)
        match = keyframes.register(recent, rows, node, float(search_m), float(search_rad))
        attempt = Attempt(anchor, node, len(recent), match)
        failed = attempt.failed_gate
        if match is None or failed is not None:
            self._log.append(attempt.line(f"rejected: {failed}"))
            return
        self.count += 1
        self._added.append(attempt)
        keyframes.add_match(keyframes.graph.loop_closures, anchor, node, match, MATCH_SD_M, MATCH_SD_RAD)
