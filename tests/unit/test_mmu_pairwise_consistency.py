"""Loop closures that are believed together: several weak matches that say the same of the path between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.geometry import FloatArray, Pose2
from onboard.mmu.back_end.closure_attempt import WEAK_OVERLAP_MIN, Attempt
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.loop_closure import LoopClosure
from onboard.mmu.back_end.odometry_noise import WHEELS_ALONE
from onboard.mmu.back_end.pairwise_consistency import Candidate, Candidates
from onboard.mmu.front_end.scan_matching import Match
from onboard.mmu.map.keyframes import Keyframe

MATCH = Match(Pose2(0.0, 0.0, 0.0), np.eye(3), overlap=0.4, rms_m=0.03, score=0.4, ambiguity=0.95)
OUT_M = 30  # along a hall, a keyframe each metre
ROUND_M = 90  # on, over a path without echoes, back to the hall's beginning
OFF_M = 7.0  # where odometry then takes itself to be


def lost_again(back_m: int = OUT_M) -> KeyframeGraph:
    """Along a hall and back to its beginning, where odometry is 7 m off; the hall's walls are its echoes."""
    graph = KeyframeGraph(WHEELS_ALONE)
    xs_m = [*range(OUT_M), *np.linspace(OUT_M, OFF_M, ROUND_M), *np.arange(OFF_M, OFF_M + back_m)]
    ys_m = [*[0.0] * OUT_M, *[20.0] * ROUND_M, *[2.0] * back_m]
    for i, (x_m, y_m) in enumerate(zip(xs_m, ys_m, strict=True)):
        graph.add(Keyframe(float(i), Pose2(float(x_m), y_m, 0.0), float(i), float(i), 0.0, 0.0), prior_map=False)
    return graph


def seen_from(node: int, at_m: float, rng: np.random.Generator) -> FloatArray:
    """Echoes (N, 6) on both walls of the hall, whose niches are as irregular as those of a real one."""
    rows = []
    for x_m in np.arange(at_m - 0.5, at_m + 0.5, 0.1):
        for side, seed in ((1.0, 1), (-1.0, 2)):
            niche = np.random.default_rng([seed, int(x_m // 1.7) + 100]).uniform(0.0, 3.0)
            place = x_m - at_m, side * (1.0 + niche) + rng.normal(0.0, 0.01)
            rows.append([node, node, *place, side * np.pi / 2, 1.0])
    return np.array(rows)


def candidate(node: int, x_m: float, y_m: float = 0.0) -> Candidate:
    """That the node lies there, as seen from the one that is 120 nodes older."""
    return Candidate(Attempt(node - 120, node, 60, MATCH), Pose2(x_m, y_m, 0.0), np.eye(3))


@pytest.mark.parametrize(
    ("held", "believed"),
    [
        ([(120, 0.0), (124, 0.1)], 0),
        ([(120, 0.0), (124, 0.1), (128, -0.1)], 3),
        ([(120, 0.0), (121, 0.1), (122, -0.1)], 0),  # of the same echoes
        ([(120, 0.0), (124, 4.0), (128, 8.0)], 0),
        ([(120, 0.0), (122, 5.0), (124, 0.1), (128, -0.1)], 3),
    ],
)
def test_matches_that_say_the_same_are_believed_and_others_are_not(
    held: list[tuple[int, float]], believed: int
) -> None:
    candidates = Candidates(lost_again(9))
    agreed: list[Candidate] = []
    for node, x_m in held:
        candidates.hold(candidate(node, x_m))
        agreed = candidates.agreeing()
    assert len(agreed) == believed
    assert all(abs(one.seen.x_m) < 1.0 for one in agreed)


def test_a_better_match_makes_the_held_ones_needless() -> None:
    candidates = Candidates(lost_again(9))
    for node in (120, 124):
        candidates.hold(candidate(node, 0.0))
    candidates.clear()
    candidates.hold(candidate(128, 0.0))
    assert candidates.agreeing() == []


@pytest.mark.parametrize(
    ("match", "weak"),
    [
        (MATCH, True),
        (replace(MATCH, overlap=WEAK_OVERLAP_MIN - 0.01), False),
        (replace(MATCH, rms_m=0.08), False),
        (None, False),
    ],
)
def test_what_may_be_held(match: Match | None, weak: bool) -> None:
    assert Attempt(0, 120, 60, match).weak == weak


def test_a_place_further_off_than_one_search_reaches_is_found_by_several_that_agree() -> None:
    """The hall's beginning is 7 m from where odometry, after 120 m without a loop closure, takes itself to be."""
    whole, rng = lost_again(), np.random.default_rng(5)
    graph = KeyframeGraph(WHEELS_ALONE)
    closure = LoopClosure(graph)
    for node in range(len(whole)):
        graph.add(whole[node], prior_map=False)
        if node < OUT_M or node >= OUT_M + ROUND_M:
            at_m = float(node if node < OUT_M else node - OUT_M - ROUND_M)
            graph.echoes.append(seen_from(node, at_m, rng))
            closure.search()
            graph.graph.optimise()
            closure.adopt()
    lines = closure.take_log()
    assert sum("held: searched widely" in line for line in lines) >= 3
    assert sum("adopted" in line for line in lines) >= 3
    ends = graph.graph.poses[[OUT_M + ROUND_M + 10, 10]]
    assert np.hypot(*(ends[0] - ends[1])[:2]) < 0.3, "the same place of the hall"
