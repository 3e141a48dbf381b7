"""The registry of exports: everything that can be made of a run, for the verb `export`, the page and the docs.

What takes SciPy, OpenCV or a library of the extra `export` is imported by whoever makes it: the list itself is there at
once.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from shutil import make_archive
from tempfile import TemporaryDirectory

from common.errors import StartError
from offboard.export import exporters
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import (
    DATABASE_NAME,
    MAP_PNG_NAME,
    MAP_POINTS_NAME,
    MAP_SVG_NAME,
    MapData,
    files_of_run,
)

_log = logging.getLogger("export")


class ExportError(StartError):
    """The run cannot be exported as requested; the message is one sentence with the reason."""


@dataclass(frozen=True, slots=True)
class LiveExport:
    """For the page, which has the map of now and no run folder."""

    media_type: str
    make: exporters.Renderer

    def render(self, data: MapData) -> bytes:
        return self.make(data, TitleBlock(date=f"{datetime.now():%Y-%m-%d %H:%M}"))


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """`title` is what a person reads of it, `needs` are packages of the extra `export`.

    `of_messages`: it is made from the run database, which a folder of `replay` lacks.
    """

    title: str
    of_run: exporters.Exporter
    live: LiveExport | None = None
    needs: tuple[str, ...] = ()
    of_messages: bool = False

    def missing(self) -> list[str]:
        """Those of its packages that are not installed."""
        return [package for package in self.needs if find_spec(package) is None]


EXPORTS: dict[str, ExportFormat] = {
    "pdf": ExportFormat(
        "drawing on A4 or A3, 1 cm for 1 m: what to print",
        exporters.drawing("map.pdf", exporters.pdf),
        LiveExport("application/pdf", exporters.pdf),
        needs=("reportlab",),
    ),
    "svg": ExportFormat(
        "drawing on one sheet, 1 cm for 1 m",
        exporters.drawing(MAP_SVG_NAME, exporters.svg),
        LiveExport("image/svg+xml", exporters.svg),
    ),
    "png": ExportFormat(
        "picture, 150 dots per inch",
        exporters.drawing(MAP_PNG_NAME, exporters.png),
        LiveExport("image/png", exporters.png),
    ),
    "dxf": ExportFormat(
        "for CAD, in metres: layers walls, inferred, doors, text, no-go",
        exporters.drawing("map.dxf", exporters.dxf),
        LiveExport("image/vnd.dxf", exporters.dxf),
        needs=("ezdxf",),
    ),
    "geojson": ExportFormat(
        "walls, doors, halls with OpenStreetMap's indoor tags",
        exporters.geojson,
        LiveExport("application/geo+json", exporters.geojson_without_halls),
    ),
    "tables": ExportFormat("doors.csv, and areas.csv with the area of every hall", exporters.tables),
    "csv": ExportFormat(
        "wall points in metres", exporters.copies(MAP_POINTS_NAME), LiveExport("text/csv", exporters.points)
    ),
    "tum": ExportFormat(
        "path, as estimated at the time and in the end; in simulation the true one", exporters.trajectories
    ),
    "json": ExportFormat("points of interest, with their photos", exporters.pois),
    "pgm": ExportFormat("occupancy image with map.yaml, as ROS map servers read it", exporters.occupancy),
    "mcap": ExportFormat(
        "every message of the run, for log players such as Foxglove and Lichtblick",
        exporters.mcap,
        needs=("mcap", "mcap_protobuf", "foxglove_schemas_protobuf"),
        of_messages=True,
    ),
    "bag": ExportFormat("ROS 2 bag: map, poses, sonars, doors", exporters.bag, needs=("rosbags",), of_messages=True),
}


def export(run_dir: Path, to: Path, formats: Sequence[str] = (), block: TitleBlock | None = None) -> list[Path]:
    """Writes the run in these formats into the folder `to`, in all that can be made of it when none is named.

    Returns the files. Raises ExportError, RunFolderError and RunDatabaseError for what is damaged, OSError.
    """
    for name in formats:
        if name not in EXPORTS:
            raise ExportError(f"There is no export format '{name}'; choose from {', '.join(EXPORTS)}")
        if missing := EXPORTS[name].missing():
            raise ExportError(_advice(name, missing))
    there = _checked(run_dir)
    if to.exists() and to.samefile(run_dir):
        raise ExportError(f"{to} is the run's own folder; choose another one with --to")
    to.mkdir(parents=True, exist_ok=True)
    files = [
        file
        for name in formats or _possible(there)
        for file in EXPORTS[name].of_run(run_dir, to, title(run_dir, block))
    ]
    if MAP_POINTS_NAME not in there:
        _log.warning("%s holds no map yet, only %s.", run_dir, ", ".join(there))
    return files


def title(run_dir: Path, block: TitleBlock | None = None) -> TitleBlock:
    """A title block with the run's date, where it knows one: a run in lockstep does not."""
    from offboard.runs.run_database import RunReader

    block = block or TitleBlock()
    if block.date or not (run_dir / DATABASE_NAME).exists():
        return block
    with RunReader(run_dir) as run:
        dates = run.dates()
    return replace(block, date=f"{dates[0]:%Y-%m-%d %H:%M}") if dates else block


def as_one_file(run_dir: Path, name: str, block: TitleBlock) -> tuple[str, bytes]:
    """Name and content of what a format makes of a run, for the page; several files are one archive.

    Raises as `export`.
    """
    with TemporaryDirectory() as folder:
        files = export(run_dir, Path(folder) / name, [name], block)
        if len(files) == 1 and files[0].is_file():
            return files[0].name, files[0].read_bytes()
        return f"{name}.zip", Path(make_archive(str(Path(folder) / "all"), "zip", Path(folder) / name)).read_bytes()


def formats_of(run_dir: Path) -> list[str]:
    """Those that can be made of a run here."""
    there = files_of_run(run_dir)
    return [name for name in EXPORTS if not _obstacle(name, there)]


def _possible(there: Sequence[str]) -> list[str]:
    """Those that can be made, with a line in the log for each other one."""
    obstacles = {name: _obstacle(name, there) for name in EXPORTS}
    for obstacle in filter(None, obstacles.values()):
        _log.warning("%s", obstacle)
    return [name for name, obstacle in obstacles.items() if not obstacle]


def _obstacle(name: str, there: Sequence[str]) -> str:
    """Why a run with these files cannot be made into a format here; empty where it can."""
    if missing := EXPORTS[name].missing():
        return _advice(name, missing)
    if EXPORTS[name].of_messages and DATABASE_NAME not in there:
        return f"The run has no {DATABASE_NAME}, which the format '{name}' is made from."
    return ""


def _advice(name: str, missing: Sequence[str]) -> str:
    return (
        f"The format '{name}' needs the Python package {', '.join(missing)}: ./deploy/local.sh --setup-only, or "
        "pip install 'indoor-mapping[export]', installs it"
    )


def _checked(run_dir: Path) -> list[str]:
    """What there is to export. A run that has just begun has no map yet, which is no error."""
    lists_them = "`indoor-mapping runs` lists the runs"
    if not run_dir.is_dir():
        raise ExportError(f"There is no run folder at {run_dir}; {lists_them}")
    there = files_of_run(run_dir)
    if not there:
        raise ExportError(f"{run_dir} holds no run that could be exported; {lists_them}")
    return there
