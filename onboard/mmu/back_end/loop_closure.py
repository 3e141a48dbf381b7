"""Loop closure: what was driven lately is matched against what was driven at the same place before.

Every loop closure that is tried passes its gates or is rejected: first those of the scan match (`closure_attempt`),
then, once the graph has settled with it, that of its chi-squared. One that is weak is held until others agree with it
(`pairwise_consistency`), and so is one found where the robot may be further off than one search reaches.
`take_log` reports each with its figures.
"""

from __future__ import annotations

from collections import deque
from math import radians

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.closure_attempt import ADOPTED_CHI2_MAX, POINTS_MIN, Attempt
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.odometry_noise import SEARCH_MAX_M
from onboard.mmu.back_end.pairwise_consistency import Candidate, Candidates
from onboard.mmu.front_end.scan_matching import Match

# Where a loop closure is tried. The sensitivity to these lengths was not measured
RECENT_M = 5.0  # of path that is matched as one
RECENT_MAX_M = 12.0  # where fewer echoes than these were received in it
RECENT_POINTS = 60
GAP_M = 12.0  # of path before a place counts as visited before
REACH_M = 3.0
SPAN_M = 7.0  # of the earlier path, before and after the place; longer by as much as what is matched is
PASSES_MAX = 4  # that are tried, as long as not so many of them match:
MATCHES_MAX = 2
# Where the robot may be further off than one search reaches: the earlier path there is searched place by place
WIDE_EVERY_M = 2.0  # of path
WIDE_STEP_M = 5.0  # of the earlier path, from one place to the next

# Loop closures that odometry's noise allows pass the last gate, but for wrong ones. Logs of wheels with a gyro lost at
# most four of any ten, three of them in a row; one of wheels alone eight in a row
JUDGED = 8
CONTRADICTED_MIN = 6  # of the newest ones judged

# A match is trusted no further than the sonars' systematic errors
MATCH_SD_M = 0.07
MATCH_SD_RAD = radians(0.6)


class LoopClosure:
    """`search` adds loop closures to the graph; `adopt`, once the graph has settled, judges those that were added."""

    def __init__(self, keyframes: KeyframeGraph) -> None:
        self.count = 0  # of those that were added
        self._keyframes = keyframes
        self._added: list[Attempt] = []  # and not judged yet
        self._candidates = Candidates(keyframes)
        self._searched_widely_m = 0.0  # path at the last time
        self._judged: deque[bool] = deque(maxlen=JUDGED)  # whether each was adopted
        self._log: list[str] = []  # five lines at most for each search

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
        lost_m = keyframes.noise.lost_m(graph_paths_m)
        wide = np.flatnonzero((lost_m > SEARCH_MAX_M) & (near_m < lost_m))
        for _ in range(PASSES_MAX):
            reachable = np.flatnonzero(near_m < reach_m)
            if not len(reachable) or len(self._added) >= MATCHES_MAX:
                break
            first_m = paths_m[reachable[0]]
            of_pass = reachable[paths_m[reachable] < first_m + 2 * REACH_M]
            anchor = int(of_pass[near_m[of_pass].argmin()])
            self._try_pass(anchor, mine, rows, span_m, float(graph_paths_m[anchor]))
            near_m[paths_m < first_m + 2 * span_m] = np.inf
        if len(wide) and not self._added and keyframes.path_m - self._searched_widely_m >= WIDE_EVERY_M:
            self._searched_widely_m = keyframes.path_m
            self._search_widely(wide, mine, rows, span_m)

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
        if match is not None and failed is None:
            self._candidates.clear()
            self._add(attempt, *keyframes.measured(anchor, node, match, MATCH_SD_M, MATCH_SD_RAD))
        elif match is not None and attempt.weak and failed != "ambiguous":
            self._hold(attempt, match, f"held: {failed}")
        else:
            self._log.append(attempt.line(f"rejected: {failed}"))

    def _search_widely(self, anchors: npt.NDArray[np.intp], node: int, recent: FloatArray, span_m: float) -> None:
        """Somewhere along these earlier nodes, place by place; the best match is held until others agree with it."""
        keyframes = self._keyframes
        begins_m, searched_m = float(recent[:, 1].min()), -np.inf
        found: list[tuple[Attempt, Match]] = []
        for anchor in anchors.tolist():
            path_m = keyframes.paths_m[anchor]
            if path_m - searched_m < WIDE_STEP_M:
                continue
            searched_m = path_m
            rows = keyframes.echoes.stretch(path_m - span_m, min(path_m + span_m, begins_m - 2.0))
            if len(rows) < POINTS_MIN:
                continue
            match = keyframes.register(recent, rows, node, SEARCH_MAX_M, keyframes.noise.lost_max_rad, begin_at=anchor)
            attempt = Attempt(anchor, node, len(recent), match)
            if match is not None and attempt.weak:
                found.append((attempt, match))
        if found:
            self._hold(*max(found, key=lambda pair: pair[1].score), "held: searched widely")

    def _hold(self, attempt: Attempt, match: Match, verdict: str) -> None:
        """Until others agree with it."""
        self._log.append(attempt.line(verdict))
        measured = self._keyframes.measured(attempt.anchor, attempt.node, match, MATCH_SD_M, MATCH_SD_RAD)
        self._candidates.hold(Candidate(attempt, *measured))
        for candidate in self._candidates.agreeing():
            self._add(candidate.attempt, candidate.seen, candidate.information)

    def _add(self, attempt: Attempt, seen: Pose2, information: FloatArray) -> None:
        self.count += 1
        self._added.append(attempt)
        self._keyframes.graph.loop_closures.add(attempt.anchor, attempt.node, seen, information)
