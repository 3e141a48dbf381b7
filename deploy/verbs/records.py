"""Verbs `runs` and `export`: what was recorded, and in the formats of others."""

from __future__ import annotations

import argparse
from math import nan, radians
from pathlib import Path
from typing import Any

from common.errors import StartError
from offboard.export.formats import EXPORTS, export
from offboard.export.title import PAPERS_MM, TitleBlock

RUNS_FOLDER = Path("runs")


def add_verbs(verbs: Any) -> None:
    runs = verbs.add_parser("runs", help="recorded runs: floor, date, duration, figures")
    runs.add_argument("folder", nargs="*", type=Path, default=[RUNS_FOLDER], help=f"where runs are ({RUNS_FOLDER})")
    runs.set_defaults(run=_runs)
    export = verbs.add_parser("export", help="a run in the formats of others")
    export.add_argument("folder", metavar="RUN", type=Path, help="run folder, or its name below runs/")
    export.add_argument("--to", type=Path, required=True, metavar="DIR", help="folder for the files")
    export.add_argument("--format", default="", help=f"comma-separated: {','.join(EXPORTS)} (all)")
    export.add_argument("--title", default="", metavar="TEXT", help="of the drawings (the run folder's name)")
    export.add_argument("--building", default="", metavar="TEXT", help="what the drawings name as the building")
    export.add_argument("--level", default="0", metavar="LEVEL", help="floor of the building, ground floor 0 (0)")
    export.add_argument("--paper", choices=tuple(PAPERS_MM), default="a4", help="of the PDF (a4)")
    export.add_argument(
        "--bearing",
        type=_bearing_rad,
        metavar="DEG",
        help="compass bearing of the robot's start heading: the drawings get a north arrow",
    )
    export.add_argument(
        "--anchor",
        type=_anchor_deg,
        metavar="LAT,LON",
        help="place of the start (WGS 84; --anchor=-33.9,18.4 in the south): with --bearing, GeoJSON is in degrees",
    )
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
    if arguments.anchor is not None and arguments.bearing is None:
        raise StartError("--anchor needs --bearing too: the map is turned by it.")
    formats = [name.strip() for name in arguments.format.split(",") if name.strip()]
    block = TitleBlock(
        title=arguments.title or folder.resolve().name,
        building=arguments.building,
        level=arguments.level,
        bearing_rad=arguments.bearing,
        anchor_deg=arguments.anchor,
        paper=arguments.paper,
    )
    print("\n".join(map(str, export(folder, arguments.to, formats, block))))
    return 0


def _bearing_rad(text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = nan
    if not -360.0 <= degrees <= 360.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no bearing in degrees, such as 120")
    return radians(degrees)


def _anchor_deg(text: str) -> tuple[float, float]:
    try:
        latitude, longitude = map(float, text.split(","))
    except ValueError:
        latitude = longitude = nan
    if not (abs(latitude) < 90.0 and abs(longitude) <= 180.0):
        raise argparse.ArgumentTypeError(f"'{text}' is no latitude and longitude in degrees, such as 48.15,11.57")
    return latitude, longitude
