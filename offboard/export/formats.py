"""Everything that `export` can make of a run: pictures, the plain files, an occupancy image. Run folder -> files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from offboard.export.map_picture import FORMATS as PICTURES
from offboard.export.map_picture import ExportError, export_run
from offboard.export.occupancy_image import image_of_run
from offboard.runs.run_folder import (
    MAP_POINTS_NAME,
    PHOTO_FOLDER,
    POIS_NAME,
    SMOOTHED_NAME,
    TRAJECTORY_NAME,
    RunFolderError,
    write_atomically,
)

Exporter = Callable[[Path, Path], list[Path]]


def _picture(name: str) -> Exporter:
    return lambda run_dir, to: export_run(run_dir, (name,), to)


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
    image = image_of_run(run_dir)
    written = [to / "map.pgm", to / "map.yaml"]
    write_atomically(written[0], image.pgm())
    write_atomically(written[1], image.yaml(written[0].name).encode())
    return written


EXPORTERS: dict[str, Exporter] = {
    **{name: _picture(name) for name in PICTURES},
    "csv": _copies(MAP_POINTS_NAME),
    "tum": _copies(TRAJECTORY_NAME, SMOOTHED_NAME),
    "json": _pois,
    "pgm": _occupancy,
}


def export(run_dir: Path, to: Path, formats: Sequence[str]) -> list[Path]:
    """Writes the run in these formats into the folder `to`; returns the files.

    Raises ExportError, RunFolderError and RunDatabaseError for what is damaged, OSError.
    """
    for name in formats:
        if name not in EXPORTERS:
            raise ExportError(f"There is no export format '{name}'; choose from {', '.join(EXPORTERS)}")
    if not run_dir.is_dir():
        raise ExportError(f"There is no run folder at {run_dir}; `indoor-mapping runs` lists them")
    if to.exists() and to.samefile(run_dir):
        raise ExportError(f"{to} is the run's own folder; choose another one with --to")
    to.mkdir(parents=True, exist_ok=True)
    return [file for name in formats for file in EXPORTERS[name](run_dir, to)]
