"""Everything that `export` can make of a run: pictures, the plain files, an occupancy image. Run folder -> files."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from offboard.recorder.run_folder import (
    MAP_POINTS_NAME,
    PHOTO_FOLDER,
    POIS_NAME,
    SMOOTHED_NAME,
    TRAJECTORY_NAME,
    write_atomically,
)
from offboard.tools.export import FORMATS as PICTURES
from offboard.tools.export import ExportError, export_run
from offboard.tools.occupancy_image import image_of_run

Exporter = Callable[[Path, Path], list[Path]]


def _picture(name: str) -> Exporter:
    return lambda run_dir, to: export_run(run_dir, (name,), to)


def _copies(*names: str) -> Exporter:
    """The files of the run folder that there are, photos with their folder."""

    def export(run_dir: Path, to: Path) -> list[Path]:
        written = []
        for name in names:
            source, target = run_dir / name, to / name
            if source.is_dir():
                shutil.copytree(source, target, dirs_exist_ok=True)
            elif source.exists():
                write_atomically(target, source.read_bytes())
            else:
                continue
            written.append(target)
        return written

    return export


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
    "json": _copies(POIS_NAME, PHOTO_FOLDER),
    "pgm": _occupancy,
}


def export(run_dir: Path, to: Path, formats: Sequence[str]) -> list[Path]:
    """Writes the run in these formats into the folder `to`; returns the files. Raises ExportError, OSError."""
    for name in formats:
        if name not in EXPORTERS:
            raise ExportError(f"no export format '{name}'; choose from {', '.join(EXPORTERS)}")
    if not run_dir.is_dir():
        raise ExportError(f"no run folder at {run_dir}; `indoor-mapping runs` lists them")
    if to.resolve() == run_dir.resolve():
        raise ExportError(f"{to} is the run's own folder; choose another one with --to")
    to.mkdir(parents=True, exist_ok=True)
    return [file for name in formats for file in EXPORTERS[name](run_dir, to)]
