"""Recorded runs at a glance: folders with a `run.sqlite` or a `trajectory.tum` -> one line each."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from common.messages import PLAN
from offboard.recorder.run_database import RunReader
from offboard.recorder.run_folder import DATABASE_NAME, SUMMARY_NAME, TRAJECTORY_NAME
from offboard.recorder.run_schema import RunDatabaseError

FIGURES = ("coverage", "map_rmse_m", "home_m", "ate_fit_m")


@dataclass(frozen=True, slots=True)
class RunLine:
    """A run as `runs` lists it; `figures` those of FIGURES that its summary has."""

    folder: Path
    date: datetime
    floor: str
    duration_s: float
    finished: bool | None  # None: nobody says
    figures: dict[str, float]

    def as_text(self) -> str:
        ended = {True: "finished", False: "not finished", None: "unknown end"}[self.finished]
        parts = [f"{self.date:%Y-%m-%d %H:%M}", f"{self.floor or '-':<10}", f"{self.duration_s:6.0f} s", ended]
        parts += [f"{name} {value:.3f}" for name, value in self.figures.items()]
        return f"{self.folder}  {', '.join(part.strip() for part in parts)}"


def read_run(folder: Path) -> RunLine:
    """From the summary where there is one, else from the database."""
    summary: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        summary = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
    date = datetime.fromtimestamp(folder.stat().st_mtime).astimezone()
    duration_s: float = summary.get("simulated_time_s", 0.0)
    finished: bool | None = summary.get("finished")
    with suppress(RunDatabaseError), RunReader(folder) as run:
        dates = run.dates()
        date = datetime.fromisoformat(dates[0]) if dates else date
        if not summary:
            view = run.latest(PLAN)
            duration_s, finished = run.duration_s(), view.payload.finished if view is not None else None
    figures = {name: float(summary[name]) for name in FIGURES if isinstance(summary.get(name), float)}
    return RunLine(folder, date, str(summary.get("floor", "")), duration_s, finished, figures)


def find_runs(roots: Iterable[Path]) -> list[RunLine]:
    """Every run in these folders or one level below, oldest first."""
    folders = {f for root in roots if root.is_dir() for f in (root, *root.iterdir()) if f.is_dir()}
    runs = [f for f in folders if any((f / name).exists() for name in (DATABASE_NAME, TRAJECTORY_NAME))]
    return sorted(map(read_run, runs), key=lambda run: (run.date, run.folder))
