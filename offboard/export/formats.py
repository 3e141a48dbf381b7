"""The registry of exports: everything that can be made of a run, for the verb `export`, the page and the docs.

What takes SciPy or OpenCV is imported by whoever makes it: the list itself is there at once.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import StartError
from offboard.runs.run_folder import (
    MAP_PNG_NAME,
    MAP_POINTS_NAME,
    MAP_SVG_NAME,
    PHOTO_FOLDER,
    POIS_NAME,
    SMOOTHED_NAME,
    TRAJECTORY_NAME,
    MapData,
    RunFolderError,
    files_of_run,
    map_points_parts,
    read_map,
    write_atomically,
)

Exporter = Callable[[Path, Path], list[Path]]  # run folder, folder for the files -> the files
Renderer = Callable[[MapData], bytes]

_log = logging.getLogger("export")


class ExportError(StartError):
    """The run cannot be exported as requested; the message is one sentence with the reason."""


@dataclass(frozen=True, slots=True)
class LiveExport:
    """For the page, which has the map of now and no run folder."""

    media_type: str
    render: Renderer


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """`title` is what a person reads of it."""

    title: str
    of_run: Exporter
    live: LiveExport | None = None


def _svg(data: MapData) -> bytes:
    from offboard.export.map_picture import as_svg

    return as_svg(data).encode()


def _png(data: MapData) -> bytes:
    from offboard.export.map_picture import as_png

    return as_png(data)


def _points(data: MapData) -> bytes:
    return b"".join(map_points_parts(data.points_m, data.inferred))


def _picture(file_name: str, render: Renderer) -> Exporter:
    def export(run_dir: Path, to: Path) -> list[Path]:
        write_atomically(to / file_name, render(read_map(run_dir)))
        return [to / file_name]

    return export


def _copies(*names: str) -> Exporter:
    """The files of the run folder that there are."""

    def export(run_dir: Path, to: Path) -> list[Path]:
        there = [name for name in names if (run_dir / name).exists()]
        for name in there:
            if not (run_dir / name).is_file():
                raise RunFolderError(f"{run_dir / name} is no file.")
            write_atomically(to / name, (run_dir / name).read_bytes())
        return [to / name for name in there]

    return export


def _pois(run_dir: Path, to: Path) -> list[Path]:
    """The records and the folder of their photos."""
    written = _copies(POIS_NAME)(run_dir, to)
    photos = run_dir / PHOTO_FOLDER
    if photos.is_dir():
        (to / PHOTO_FOLDER).mkdir(exist_ok=True)
        for photo in filter(Path.is_file, sorted(photos.iterdir())):
            write_atomically(to / PHOTO_FOLDER / photo.name, photo.read_bytes())
        written.append(to / PHOTO_FOLDER)
    return written


def _occupancy(run_dir: Path, to: Path) -> list[Path]:
    from offboard.export.occupancy_image import image_of_run

    image = image_of_run(run_dir)
    written = [to / "map.pgm", to / "map.yaml"]
    write_atomically(written[0], image.pgm())
    write_atomically(written[1], image.yaml(written[0].name).encode())
    return written


EXPORTS: dict[str, ExportFormat] = {
    "svg": ExportFormat("drawing, 1 cm for 1 m", _picture(MAP_SVG_NAME, _svg), LiveExport("image/svg+xml", _svg)),
    "png": ExportFormat("picture, prints 1 cm for 1 m", _picture(MAP_PNG_NAME, _png), LiveExport("image/png", _png)),
    "csv": ExportFormat("wall points in metres", _copies(MAP_POINTS_NAME), LiveExport("text/csv", _points)),
    "tum": ExportFormat("path, as estimated at the time and in the end", _copies(TRAJECTORY_NAME, SMOOTHED_NAME)),
    "json": ExportFormat("points of interest, with their photos", _pois),
    "pgm": ExportFormat("occupancy image with map.yaml, as ROS map servers read it", _occupancy),
}


def export(run_dir: Path, to: Path, formats: Sequence[str]) -> list[Path]:
    """Writes the run in these formats into the folder `to`; returns the files.

    Raises ExportError, RunFolderError and RunDatabaseError for what is damaged, OSError.
    """
    for name in formats:
        if name not in EXPORTS:
            raise ExportError(f"There is no export format '{name}'; choose from {', '.join(EXPORTS)}")
    there = _checked(run_dir)
    if to.exists() and to.samefile(run_dir):
        raise ExportError(f"{to} is the run's own folder; choose another one with --to")
    to.mkdir(parents=True, exist_ok=True)
    files = [file for name in formats for file in EXPORTS[name].of_run(run_dir, to)]
    if MAP_POINTS_NAME not in there:
        _log.warning("%s holds no map yet, only %s.", run_dir, ", ".join(there))
    return files


def _checked(run_dir: Path) -> list[str]:
    """What there is to export. A run that has just begun has no map yet, which is no error."""
    lists_them = "`indoor-mapping runs` lists the runs"
    if not run_dir.is_dir():
        raise ExportError(f"There is no run folder at {run_dir}; {lists_them}")
    there = files_of_run(run_dir)
    if not there:
        raise ExportError(f"{run_dir} holds no run that could be exported; {lists_them}")
    return there
