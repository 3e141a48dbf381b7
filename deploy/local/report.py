"""The summary of a local run, and the line that a person reads at its end."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from common.messages.mission import PlannerView
from common.messages.stop import Permit
from common.mission_state import mission_state
from common.node_loop import STEPS_SUFFIX
from offboard.evaluate.run_text import figures
from offboard.evaluate.summary import RunFacts, StepTimes, write_summary
from offboard.simulator.run.options import RunOptions, floor_json


def summarise(
    folder: Path,
    work: Path,
    options: RunOptions,
    view: PlannerView,
    permit: Permit | None,
    began_s: float,
    wall_s: float,
) -> str:
    """Writes summary.json; returns its closing line. `view`, `permit`: the newest; `began_s`: on the mission's clock.

    Raises OSError.
    """
    facts = RunFacts(
        floor=options.floor.stem,
        seed=options.seed,
        start=options.start,
        options=options.as_dict(),
        outcome=view.outcome,
        reason=mission_state(view, permit).text,
        blacklisted=view.blacklisted,
        simulated_time_s=round(view.t_s - began_s, 3),
        wall_time_s=round(wall_s, 3),
        steps=read_steps(work),
    )
    return closing_line(write_summary(folder, facts, floor_json(options)), folder)


def read_steps(folder: Path) -> dict[str, StepTimes]:
    """How long the steps of each process took, as it wrote at its end; a killed one wrote nothing."""
    steps = {}
    for file in sorted(folder.glob(f"*{STEPS_SUFFIX}")):
        with suppress(OSError, ValueError, KeyError, TypeError):
            figures = json.loads(file.read_text(encoding="utf-8"))
            times = StepTimes(*(figures[f"{name}_ms"] for name in ("mean", "p99", "p999", "max")))
            steps[file.name.removesuffix(STEPS_SUFFIX)] = times
    return steps


def closing_line(summary: Mapping[str, Any], folder: Path) -> str:
    """The figures that people look at first, and where the rest stands."""
    simulated_s, wall_s = summary["simulated_time_s"], summary["wall_time_s"]
    times = f"{simulated_s:.0f} s of mission in {wall_s:.0f} s"
    return f"{', '.join([times, *figures(summary)])}\nRun folder {folder}"
