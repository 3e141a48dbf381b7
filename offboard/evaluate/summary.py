"""Facts of a run (+ the floor, in simulation) -> summary.json.

Two runs with one seed give the same file but for the keys of WALL_TIME_KEYS, which depend on the machine.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from common.messages.mission import Outcome
from offboard.evaluate.figures import EvaluationError, evaluate
from offboard.runs.run_folder import SUMMARY_NAME, RunFolderError, write_json
from offboard.runs.stamped_truth import stamp_truth

WALL_TIME_KEYS = ("wall_time_s", "steps")

_log = logging.getLogger("summary")


@dataclasses.dataclass(frozen=True, slots=True)
class StepTimes:
    """How long the steps of a node took, in processor time of its thread."""

    mean_ms: float
    p99_ms: float
    p999_ms: float
    max_ms: float

    @classmethod
    def of(cls, durations_s: Sequence[float]) -> StepTimes:
        """From the duration of every step; zeros when there was none."""
        if not len(durations_s):
            return cls(0.0, 0.0, 0.0, 0.0)
        ms = np.asarray(durations_s, dtype=np.float64) * 1000
        return cls(*(round(float(v), 4) for v in (ms.mean(), *np.percentile(ms, (99.0, 99.9)), ms.max())))


@dataclasses.dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of the run, from the program that ran the nodes."""

    floor: str
    seed: int
    start: int
    options: Mapping[str, Any]
    outcome: Outcome  # as the Planner published it
    reason: str  # why the run ended
    simulated_time_s: float
    wall_time_s: float
    steps: Mapping[str, StepTimes]  # by node
    blacklisted: Sequence[str] = ()  # places that exploration left out, each with its reason


def write_summary(run_dir: Path, facts: RunFacts, floor_json: dict[str, Any] | None = None) -> dict[str, Any]:
    """Write summary.json and return its content; with a floor, the evaluation's figures stand beside the facts."""
    summary = dataclasses.asdict(facts)
    summary |= {"outcome": facts.outcome.value, "finished": facts.outcome is Outcome.FINISHED}
    summary["blacklisted"] = list(facts.blacklisted)
    if floor_json is not None:
        try:
            summary |= evaluate(floor_json, run_dir)
        except (EvaluationError, RunFolderError) as error:
            _log.warning("%s", error)
            summary["not_evaluated"] = str(error)
    with suppress(RunFolderError):  # of which the evaluation has just reported
        stamp_truth(run_dir)
    write_json(run_dir / SUMMARY_NAME, summary)
    return summary


def without_wall_time(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The part that a seed determines."""
    return {key: value for key, value in summary.items() if key not in WALL_TIME_KEYS}
