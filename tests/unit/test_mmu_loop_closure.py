"""Loop closure: its gates, and the log of every one that was tried."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from common.geometry import Pose2
from onboard.mmu.back_end.loop_closure import ADOPTED_CHI2_MAX, Attempt
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.front_end.scan_matching import Match
from onboard.mmu.slam import Slam
from tests.unit.test_mmu_faults import fed, reports

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
    assert len(tried) < slam.travel_m * 2, "two a metre at most"
    calibrations = [line for line in caplog.messages if line.startswith("calibration")]
    assert 2 <= len(calibrations) <= slam.travel_m / 5.0
