"""Loop closure: its gates, and the log of every one that was tried."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from common.geometry import Pose2
from onboard.mmu.back_end.back_end import BackEnd
from onboard.mmu.back_end.closure_attempt import ADOPTED_CHI2_MAX, Attempt
from onboard.mmu.back_end.exchange import Increment
from onboard.mmu.back_end.keyframe_graph import CLOSURE_M, KIDNAPPED_M, KeyframeGraph
from onboard.mmu.back_end.loop_closure import LoopClosure
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.back_end.odometry_noise import GYRO_LED, WHEELS_ALONE
from onboard.mmu.front_end.scan_matching import Match
from onboard.mmu.map.keyframes import Keyframe, ObservationStore
from onboard.mmu.slam import Slam
from tests.unit.test_mmu_faults import fed, reports

CENTRE = Pose2(0.0, 0.0, 0.0)
GOOD = Match(Pose2(0.1, 0.0, 0.0), np.eye(3), overlap=0.8, rms_m=0.03, score=0.7, ambiguity=0.4)


@pytest.mark.parametrize(
    ("match", "points", "gate"),
    [
        (GOOD, 100, None),
        (None, 100, "no match"),
        (replace(GOOD, overlap=0.5), 100, "overlap"),
        (replace(GOOD, rms_m=0.08), 100, "rms"),
        (GOOD, 30, "points"),
        (replace(GOOD, ambiguity=0.95), 100, "ambiguous"),
    ],
)
def test_the_first_gate_that_fails_is_named(match: Match | None, points: int, gate: str | None) -> None:
    assert Attempt(3, 90, points, match).failed_gate == gate


def test_a_line_has_every_figure_beside_its_gate() -> None:
    line = Attempt(3, 90, 100, GOOD).line("adopted", 1.5)
    assert line.startswith("loop closure adopted anchor=3 node=90 ")
    for figure in (
        "overlap=0.80 (min 0.55)",
        "rms_m=0.030 (max 0.07)",
        "points=80 (min 25)",
        "ambiguity=0.40 (max 0.9)",
    ):
        assert figure in line
    assert line.endswith(f"chi2=1.5 (max {ADOPTED_CHI2_MAX:g})")


def test_what_the_back_end_decided_is_logged_by_the_node(caplog: pytest.LogCaptureFixture) -> None:
    """Up and down a room: the place is visited again and again."""
    caplog.set_level(logging.INFO, "mmu")
    slam: Slam = fed(reports(150.0), Slam(deferred_back_end()))
    tried = [line for line in caplog.messages if line.startswith("loop closure")]
    adopted = [line for line in tried if line.startswith("loop closure adopted")]
    rejected_at_rest = [line for line in tried if line.startswith("loop closure rejected: chi2")]
    assert len(adopted) > 0
    assert len(adopted) + len(rejected_at_rest) == slam.closures
    assert len(tried) < slam.travel_m * 5, "five a metre at most"
    calibrations = [line for line in caplog.messages if line.startswith("calibration")]
    assert 2 <= len(calibrations) <= slam.travel_m / 5.0


def straight(count: int, kidnapped: int = -1, prior: int = 0) -> KeyframeGraph:
    """Keyframes a metre apart; the first `prior` are a prior map, before the one `kidnapped` the robot was carried."""
    graph = KeyframeGraph(GYRO_LED)
    for i in range(count):
        keyframe = Keyframe(float(i), Pose2(float(i), 0.0, 0.0), float(i), float(i), 0.0, 0.0, certain=i != kidnapped)
        graph.add(keyframe, prior_map=i < prior)
    return graph


def test_a_new_loop_closure_does_not_make_a_place_from_long_ago_better_known() -> None:
    """The search for it stays as wide as the way there is long; only across the closure it is a short one."""
    graph = straight(101)
    assert graph.graph_paths_m()[[0, 60, 100]] == pytest.approx([100.0, 40.0, 0.0], abs=0.01)
    graph.close_loop(60, 95)
    assert graph.graph_paths_m()[[0, 60]] == pytest.approx([60.0 + CLOSURE_M + 5.0, CLOSURE_M + 5.0], abs=0.01)
    window_m = graph.noise.search_window(graph.graph_paths_m())[0]
    assert window_m[0] > window_m[60] + 1.0


def test_the_way_through_a_prior_map_costs_nothing_and_being_carried_much() -> None:
    assert straight(21, prior=11).graph_paths_m()[0] == pytest.approx(10.0, abs=0.1)
    assert straight(21, kidnapped=15).graph_paths_m()[0] == pytest.approx(19.0 + KIDNAPPED_M, abs=0.1)
    assert straight(1).graph_paths_m() == pytest.approx([0.0])


def test_a_stretch_is_as_long_as_its_echoes_are_few() -> None:
    few, many = ObservationStore(), ObservationStore()
    few.append([[0, 0.5 * i, 0, 0, 0, 1] for i in range(60)])
    many.append([[0, 0.05 * i, 0, 0, 0, 1] for i in range(600)])
    assert np.ptp(many.newest(30.0, 5.0, 12.0, 20)[:, 1]) == pytest.approx(5.0, abs=0.2)
    assert np.ptp(few.newest(30.0, 5.0, 12.0, 20)[:, 1]) == pytest.approx(9.5, abs=0.6)
    assert np.ptp(few.newest(30.0, 5.0, 12.0, 200)[:, 1]) == pytest.approx(11.5, abs=0.6)
    assert len(ObservationStore().newest(30.0, 5.0, 12.0, 20)) == 0


def judged(verdicts: str) -> LoopClosure:
    """After loop closures that the graph agreed with (+) or not (-), each 15 m of path after what it closes on."""
    keyframes = straight(40)
    closure = LoopClosure(keyframes)
    for i, verdict in enumerate(verdicts):
        measured = Pose2(15.0, 0.0 if verdict == "+" else 3.0, 0.0)
        keyframes.graph.loop_closures.add(i, i + 15, measured, np.diag([0.1**-2, 0.1**-2, 0.02**-2]))
        closure._added.append(Attempt(i, i + 15, 100, GOOD))
        closure.adopt()
    return closure


@pytest.mark.parametrize(
    ("verdicts", "contradicted"),
    [("", False), ("---++++++++", False), ("+-+-+-+-+-", False), ("++------", True), ("++++++++------", True)],
)
def test_odometry_is_contradicted_by_most_loop_closures_not_by_a_few_wrong_ones(
    verdicts: str, contradicted: bool
) -> None:
    assert judged(verdicts).contradicted == contradicted


def test_a_back_end_that_trusts_no_gyro_yet_begins_anew_where_loop_closures_contradict_odometry(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    back_end = BackEnd(gyro_led=False)
    monkeypatch.setattr(LoopClosure, "contradicted", True)
    lines = back_end.take(Increment((Keyframe(0.0, CENTRE, 0.0, 0.0, 0.0, 0.0),), np.zeros((0, 6)), np.zeros((0, 6))))
    assert [line for line in lines.log_lines if "odometry distrusted: most loop closures" in line]
    assert back_end._keyframes.noise is WHEELS_ALONE
    assert len(back_end._keyframes) == 1


@pytest.mark.parametrize("spacing_m", [0.1, 0.4])
def test_the_earlier_pass_is_as_long_as_what_is_matched_with_it(
    monkeypatch: pytest.MonkeyPatch, spacing_m: float
) -> None:
    """Through a hall twice: where echoes are few a longer stretch is matched, and all of it can overlap."""
    keyframes, offered = straight(60), []
    for i in range(60):
        back_m = i - 40.0 if i >= 40 else float(i)
        keyframes.graph._poses.rows[i] = (back_m, 0.0, 0.0)
    at_m = np.arange(0.0, 59.0, spacing_m)
    keyframes.echoes.append([[int(s), s, s - int(s), 1.0, 1.5, 1.0] for s in at_m])
    monkeypatch.setattr(keyframes, "register", lambda mine, other, *_: offered.append((mine, other)))
    LoopClosure(keyframes).search()
    mine, other = offered[0]
    first_m, last_m = float(other[:, 1].min()), float(other[:, 1].max())
    assert first_m < mine[0, 1] - 40.0 + 0.5
    assert last_m > mine[-1, 1] - 40.0 - 0.5
