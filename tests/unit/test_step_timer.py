"""How long steps took: of all of them mean and longest, of the newest the percentiles."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from common import node_loop
from common.node_loop import StepTimer


def figures(timer: StepTimer, file: Path) -> dict[str, float]:
    timer.write(file)
    content: dict[str, float] = json.loads(file.read_text(encoding="utf-8"))
    return content


def test_percentile_forgets_the_oldest_steps_and_the_longest_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node_loop, "_STEPS_KEPT", 4)
    timer = StepTimer()
    for duration_s in (8.0, 1.0, 1.0, 1.0, 1.0):
        timer.add(duration_s)
    newest = {"p99_ms": 1000.0, "p999_ms": 1000.0}
    assert figures(timer, tmp_path / "steps") == {"mean_ms": 2400.0, "max_ms": 8000.0, "count": 5} | newest


def test_what_has_not_come_yet_counts_for_nothing(tmp_path: Path) -> None:
    timer = StepTimer()
    timer.add(0.5)
    assert figures(timer, tmp_path / "steps")["p99_ms"] == 500.0


def test_no_step_leaves_no_file(tmp_path: Path) -> None:
    StepTimer().write(tmp_path / "steps")
    assert not (tmp_path / "steps").exists()
