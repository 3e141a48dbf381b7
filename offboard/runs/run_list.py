"""Recorded runs at a glance: folders with a `run.sqlite` or a `trajectory.tum` -> one line each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from common.errors import SENTENCE_MAX, StartError, sentence
from common.json_reader import Node, load_json
from common.messages.mission import Outcome
from common.messages.topics import PERMIT, PLAN
from common.mission_state import ENDED, mission_state
from common.plain_text import plain
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import DATABASE_NAME, SETTINGS_NAME, SUMMARY_NAME, TRAJECTORY_NAME, RunFolderError

_NEWEST_S = datetime(9999, 1, 1, tzinfo=UTC).timestamp()  # some file systems know later times than Python
_ADVICE = "name a folder that holds runs, or record one with `indoor-mapping local`"
FIGURES = ("coverage", "map_rmse_m", "home_m", "ate_fit_m")


@dataclass(frozen=True, slots=True)
class RunLine:
    """A run as `runs` lists it; `figures` those of FIGURES that its summary has, `damage` a sentence per bad file."""

    folder: Path
    date: datetime
    floor: str = ""
    duration_s: float | None = None
    outcome: Outcome | None = None  # None: not recorded
    state: str = ""  # what it did last, in the words of common/mission_state.py
    figures: dict[str, float] = field(default_factory=dict)
    damage: tuple[str, ...] = ()

    def as_text(self) -> str:
        parts = [f"{self.date:%Y-%m-%d %H:%M}", self.floor or "-", f"{self.duration_s or 0.0:.0f} s", self.end_text]
        parts += [f"{name} {value:.3f}" for name, value in self.figures.items()]
        return plain(". DAMAGED: ".join([f"{self.folder}  {', '.join(parts)}", *self.damage]), SENTENCE_MAX)

    @property
    def end_text(self) -> str:
        """How it ended."""
        if self.outcome is None:
            return "unknown end"
        ended = ENDED.get(self.outcome)
        return ended or (f"not ended: {self.state}" if self.state else "not ended")


def _with_change_time(line: RunLine) -> RunLine:
    changed_s = min(max(line.folder.stat().st_mtime, 0.0), _NEWEST_S)
    return replace(line, date=datetime.fromtimestamp(changed_s, UTC).astimezone())


def _with_settings(line: RunLine) -> RunLine:
    """As a simulated run has them from its beginning on."""
    file = line.folder / SETTINGS_NAME
    if not file.exists():
        return line
    return replace(
        line, floor=Node(load_json(file, str(file), RunFolderError), str(file), RunFolderError).text("floor")
    )


def _with_summary(line: RunLine) -> RunLine:
    file = line.folder / SUMMARY_NAME
    if not file.exists():
        return line
    summary = Node(load_json(file, str(file), RunFolderError), str(file), RunFolderError)
    return replace(
        line,
        floor=summary.text("floor"),
        duration_s=summary.number("simulated_time_s"),
        outcome=_outcome(summary),
        state=summary.text("reason") if summary.has("reason") else "",
        figures={name: summary.number(name) for name in filter(summary.has, FIGURES)},
    )


def _outcome(summary: Node) -> Outcome:
    """As it is written; older summaries only have whether the mission was finished."""
    if not summary.has("outcome"):
        return Outcome.FINISHED if summary.flag("finished") else Outcome.NONE
    word = summary.text("outcome")
    known = {outcome.value: outcome for outcome in Outcome}
    if word not in known:
        raise summary.error("outcome", f"must be one of {', '.join(known)}")
    return known[word]


def _with_database(line: RunLine) -> RunLine:
    if not (line.folder / DATABASE_NAME).exists():
        return line
    with RunReader(line.folder) as run:
        dates = run.dates()
        line = replace(line, date=dates[0] if dates else line.date)
        if line.duration_s is None:
            view = run.latest(PLAN)
            if view is not None:
                permit = run.latest(PERMIT)
                state = mission_state(view.payload, permit.payload if permit is not None else None)
                line = replace(line, outcome=view.payload.outcome, state=state.text)
            line = replace(line, duration_s=run.duration_s())
    return line


def read_run(folder: Path) -> RunLine:
    """From the summary where there is one, else from the database; damaged files are listed in `damage`."""
    line = RunLine(folder, datetime.fromtimestamp(0, UTC))
    for read in (_with_change_time, _with_settings, _with_summary, _with_database):
        try:
            line = read(line)
        except (StartError, OSError) as error:
            line = replace(line, damage=(*line.damage, sentence(error)))
    return line


def _holds_run(folder: Path) -> bool:
    """True also for a folder without permission to read: reading it then reports that."""
    try:
        return folder.is_dir() and any((folder / name).exists() for name in (DATABASE_NAME, TRAJECTORY_NAME))
    except OSError:
        return True


def find_runs(roots: Sequence[Path]) -> list[RunLine]:
    """Every run in these folders or one level below, oldest first.

    Raises RunFolderError where there is no such folder or no run in any of them, OSError for one nobody may look into.
    """
    for root in roots:
        if not root.is_dir():
            raise RunFolderError(f"There is no folder {root}; {_ADVICE}")
    folders = {folder for root in roots for folder in (root, *root.iterdir())}
    runs = [read_run(folder) for folder in folders if _holds_run(folder)]
    if not runs:
        looked_in = ", ".join(map(str, roots))
        raise RunFolderError(f"No run in {looked_in}: a run has {DATABASE_NAME} or {TRAJECTORY_NAME}; {_ADVICE}")
    return sorted(runs, key=lambda run: (run.date, run.folder))
