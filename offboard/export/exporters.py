"""What makes the formats: run folder, target folder and title block -> files, or map data and title block -> bytes.

A library is imported by whoever needs it, when it is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from offboard.export.title import TitleBlock
from offboard.export.whole_file import written_whole
from offboard.runs.run_folder import (
    PHOTO_FOLDER,
    POIS_NAME,
    SMOOTHED_NAME,
    TRAJECTORY_NAME,
    TRUTH_NAME,
    MapData,
    RunFolderError,
    map_points_parts,
    read_map,
    write_atomically,
)

Exporter = Callable[[Path, Path, TitleBlock], list[Path]]  # run folder, folder for the files -> the files
Renderer = Callable[[MapData, TitleBlock], bytes]


def svg(data: MapData, block: TitleBlock) -> bytes:
    from offboard.export import map_picture

    return map_picture.as_svg(data, block).encode()


def png(data: MapData, block: TitleBlock) -> bytes:
    from offboard.export import map_picture

    return map_picture.as_png(data, block)


def pdf(data: MapData, block: TitleBlock) -> bytes:
    from offboard.export.pdf_sheets import as_pdf

    return as_pdf(data, block)


def dxf(data: MapData, block: TitleBlock) -> bytes:
    from offboard.export.dxf_plan import as_dxf

    return as_dxf(data, block)


def points(data: MapData, _: TitleBlock) -> bytes:
    return b"".join(map_points_parts(data.points_m, data.inferred))


def drawing(file_name: str, render: Renderer) -> Exporter:
    def export(run_dir: Path, to: Path, block: TitleBlock) -> list[Path]:
        write_atomically(to / file_name, render(read_map(run_dir), block))
        return [to / file_name]

    return export


def copies(*names: str) -> Exporter:
    """The files of the run folder that there are."""

    def export(run_dir: Path, to: Path, _: TitleBlock) -> list[Path]:
        there = [name for name in names if (run_dir / name).exists()]
        for name in there:
            if not (run_dir / name).is_file():
                raise RunFolderError(f"{run_dir / name} is no file.")
            write_atomically(to / name, (run_dir / name).read_bytes())
        return [to / name for name in there]

    return export


def pois(run_dir: Path, to: Path, block: TitleBlock) -> list[Path]:
    """The records and the folder of their photos."""
    written = copies(POIS_NAME)(run_dir, to, block)
    photos = run_dir / PHOTO_FOLDER
    if photos.is_dir():
        (to / PHOTO_FOLDER).mkdir(exist_ok=True)
        for photo in filter(Path.is_file, sorted(photos.iterdir())):
            write_atomically(to / PHOTO_FOLDER / photo.name, photo.read_bytes())
        written.append(to / PHOTO_FOLDER)
    return written


def trajectories(run_dir: Path, to: Path, block: TitleBlock) -> list[Path]:
    """The truth of a simulated run with the stamps of both, which a run that was cut off does not have yet."""
    from offboard.runs.stamped_truth import stamp_truth

    written = copies(TRAJECTORY_NAME, SMOOTHED_NAME, TRUTH_NAME)(run_dir, to, block)
    stamp_truth(to)
    return written


def occupancy(run_dir: Path, to: Path, _: TitleBlock) -> list[Path]:
    from offboard.export.occupancy_image import image_of_run

    image = image_of_run(run_dir)
    written = [to / "map.pgm", to / "map.yaml"]
    write_atomically(written[0], image.pgm())
    write_atomically(written[1], image.yaml(written[0].name).encode())
    return written


def geojson(run_dir: Path, to: Path, block: TitleBlock) -> list[Path]:
    from offboard.export.geojson import as_geojson
    from offboard.export.halls import spaces_of_run

    write_atomically(to / "map.geojson", as_geojson(read_map(run_dir), spaces_of_run(run_dir), block))
    return [to / "map.geojson"]


def geojson_without_halls(data: MapData, block: TitleBlock) -> bytes:
    """The map of now has no free space, which halls are found in."""
    from offboard.export.geojson import as_geojson

    return as_geojson(data, (), block)


def tables(run_dir: Path, to: Path, _: TitleBlock) -> list[Path]:
    from offboard.export.halls import spaces_of_run
    from offboard.export.tables import areas_table, doors_table

    pois, spaces = read_map(run_dir).pois, spaces_of_run(run_dir)
    written = [to / "doors.csv", to / "areas.csv"]
    for path, table in zip(written, (doors_table, areas_table), strict=True):
        write_atomically(path, table(pois, spaces))
    return written


def mcap(run_dir: Path, to: Path, _: TitleBlock) -> list[Path]:
    from offboard.export.mcap_log import write_mcap

    with written_whole(to / "run.mcap") as part, part.open("wb") as file:
        write_mcap(run_dir, file)
    return [to / "run.mcap"]


def bag(run_dir: Path, to: Path, _: TitleBlock) -> list[Path]:
    from offboard.export.ros_bag import write_bag

    with written_whole(to / "ros2_bag") as part:
        write_bag(run_dir, part)
    return [to / "ros2_bag"]
