"""Verbs `runs` and `export`: what was recorded, and in the formats of others."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from offboard.export.formats import EXPORTS, export

RUNS_FOLDER = Path("runs")


def add_verbs(verbs: Any) -> None:
    runs = verbs.add_parser("runs", help="recorded runs: floor, date, duration, figures")
    runs.add_argument("folder", nargs="*", type=Path, default=[RUNS_FOLDER], help=f"where runs are ({RUNS_FOLDER})")
    runs.set_defaults(run=_runs)
    export = verbs.add_parser("export", help="a run in the formats of others")
    export.add_argument("folder", metavar="RUN", type=Path, help="run folder, or its name below runs/")
    export.add_argument("--to", type=Path, required=True, metavar="DIR", help="folder for the files")
    export.add_argument("--format", default="", help=f"comma-separated: {','.join(EXPORTS)} (all)")
    export.set_defaults(run=_export)


def _runs(arguments: argparse.Namespace) -> int:
    from offboard.runs.run_list import find_runs  # here, because the other verbs need none of it

    lines = [run.as_text() for run in find_runs(arguments.folder)]
    print("\n".join(lines))
    return 0


def _export(arguments: argparse.Namespace) -> int:
    folder: Path = arguments.folder
    if not folder.is_dir() and (RUNS_FOLDER / folder).is_dir():
        folder = RUNS_FOLDER / folder
    formats = [name.strip() for name in arguments.format.split(",") if name.strip()] or list(EXPORTS)
    print("\n".join(map(str, export(folder, arguments.to, formats))))
    return 0
