"""The layout of a run folder in one place: names, writers, readers.

Recorder, simulator and replay write it; evaluation, export, visualizer and command center read it. A file is written
whole under another name and then renamed, so that a reader never meets half of one; only `trajectory.tum` and
`truth.tum` grow line by line. Every reader raises RunFolderError for a file that cannot be read, or does not hold what
it should.
"""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from math import cos, isfinite, sin
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from common.errors import StartError
from common.geometry import FloatArray, Points
from common.json_reader import Node, load_json
from common.text_file import read_text
from common.zones import Zone, of_json

TRAJECTORY_NAME = "trajectory.tum"  # the poses as they were published at the time
SMOOTHED_NAME = "trajectory_smoothed.tum"  # the path as it was estimated in the end
TRUTH_NAME = "truth.tum"  # simulation only
MAP_POINTS_NAME = "map_points.csv"
POIS_NAME = "pois.json"
ZONES_NAME = "zones.json"  # no-go lines and areas
SETTINGS_NAME = "settings.json"  # floor, start and seed, simulation only
SUMMARY_NAME = "summary.json"
DATABASE_NAME = "run.sqlite"  # every message of the run
MAP_SVG_NAME = "map.svg"
MAP_PNG_NAME = "map.png"
PHOTO_FOLDER = "photos"

RECORDED_NAMES = (DATABASE_NAME, TRAJECTORY_NAME, SMOOTHED_NAME, MAP_POINTS_NAME, POIS_NAME)  # what makes it a run

MAP_HEADER = "x_m,y_m,inferred"
MAP_REACH_M = 500.0  # along either axis from the start: what claims to lie farther lies on no floor

_ROWS_AT_ONCE = 10_000
_POSE_FORM = "t x y z qx qy qz qw"
_POI_TEXTS = (
    *("name", "description", "number", "room_type", "state", "photo"),
    *("number_read", "state_read", "room_name", "judged"),  # where a person said something of it
)

_log = logging.getLogger(__name__)


class RunFolderError(StartError):
    """A file of a run folder does not hold what it should: one sentence with file and place."""


@dataclass(frozen=True, slots=True)
class MapData:
    """Everything a picture of the map shows, in the message `map`."""

    points_m: Points  # (N, 2) wall points
    inferred: npt.NDArray[np.uint8]  # (N,) 1 where a wall was inferred, not echoed
    trajectory: FloatArray  # (K, 3) x, y, heading
    pois: list[dict[str, Any]] = field(default_factory=list)  # the records of pois.json
    zones: tuple[Zone, ...] = ()


def write_atomically(path: Path, data: bytes | Iterable[bytes]) -> None:
    """The whole file or, with an OSError, none of it: the old one stays."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as file:
            file.writelines([data] if isinstance(data, bytes) else data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def sync_folder(folder: Path) -> None:
    """The names in it outlive a power cut from now on; raises OSError."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class LineFile:
    """A text file that grows by whole lines. What a crash left of a last line is cut off when it is opened again.

    `size` is how many bytes it has.
    """

    def __init__(self, path: Path, keep_bytes: int | None = None) -> None:
        """`keep_bytes`: of what the file holds already; None for all whole lines."""
        if keep_bytes is None:
            existing = path.read_bytes() if path.exists() else b""
            keep_bytes = existing.rfind(b"\n") + 1
        self.size = keep_bytes
        self._file = path.open("ab", buffering=0)
        self._file.truncate(self.size)

    def append(self, lines: Iterable[str]) -> None:
        """Write the lines; raises OSError when the disk takes none, and then leaves the file as it was."""
        data = "".join(f"{line}\n" for line in lines).encode()
        try:
            if self._file.write(data) != len(data):
                raise OSError(errno.ENOSPC, "the disk took a part of it only")
        except OSError:
            self._file.truncate(self.size)
            raise
        self.size += len(data)

    def sync(self) -> None:
        """What was appended outlives a power cut from now on."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


def tum_line(t_s: float, x_m: float, y_m: float, heading_rad: float) -> str:
    """One pose in the format of the TUM benchmarks: `t x y z qx qy qz qw`."""
    half = heading_rad / 2
    return f"{t_s:.4f} {x_m:.4f} {y_m:.4f} 0 0 0 {sin(half):.7f} {cos(half):.7f}"


def read_tum(path: Path) -> tuple[FloatArray, FloatArray]:
    """Times (K,) in seconds and poses (K, 3) as x, y, heading; both empty when the file holds none.

    A last line without its end is being written, or was when its writer died: it is no pose yet.
    """
    lines = read_text(path, str(path), RunFolderError).split("\n")[:-1]
    rows = [(number, line.split()) for number, line in enumerate(lines, 1) if line and line[0] != "#"]
    table = _numbers(path, rows, _POSE_FORM)
    heading_rad = 2 * np.arctan2(table[:, 6], table[:, 7])
    return table[:, 0], np.column_stack([table[:, 1:3], heading_rad])


def write_tum(path: Path, times_s: FloatArray, poses: FloatArray) -> None:
    """Times (K,) and poses (K, 3); replaces the file."""
    write_atomically(path, _in_parts(lambda part: _tum_lines(times_s[part], poses[part]), len(times_s)))


def _tum_lines(times_s: FloatArray, poses: FloatArray) -> str:
    pairs = zip(times_s.tolist(), poses.tolist(), strict=True)
    return "".join(f"{tum_line(t_s, *pose)}\n" for t_s, pose in pairs)


def map_points_parts(points_m: npt.NDArray[np.floating[Any]], inferred: npt.NDArray[np.uint8]) -> Iterator[bytes]:
    """Wall points (N, 2) and their marks (N,) as a map_points.csv holds them."""
    yield f"{MAP_HEADER}\n".encode()
    yield from _in_parts(lambda part: _point_lines(points_m[part], inferred[part]), len(points_m))


def _point_lines(points_m: npt.NDArray[np.floating[Any]], inferred: npt.NDArray[np.uint8]) -> str:
    rows = zip(points_m.tolist(), inferred.tolist(), strict=True)
    return "".join(f"{x:.3f},{y:.3f},{mark}\n" for (x, y), mark in rows)


def _in_parts(text: Callable[[slice], str], rows: int) -> Iterator[bytes]:
    """Text of so many rows: as Python's own numbers and strings all of a large map would take 300 MB."""
    for start in range(0, rows, _ROWS_AT_ONCE):
        yield text(slice(start, start + _ROWS_AT_ONCE)).encode()


def write_map_points(path: Path, points_m: npt.NDArray[np.floating[Any]], inferred: npt.NDArray[np.uint8]) -> None:
    """Wall points (N, 2) and their marks (N,); replaces the file."""
    write_atomically(path, map_points_parts(points_m, inferred))


def read_map_points(path: Path) -> tuple[Points, npt.NDArray[np.uint8]]:
    """Wall points (N, 2) and their marks (N,)."""
    header, *lines = read_text(path, str(path), RunFolderError).split("\n")
    if not header.startswith(MAP_HEADER):
        raise RunFolderError(f"{path} line 1 must be the header {MAP_HEADER}.")
    rows = [(number, line.split(",")[:3]) for number, line in enumerate(lines, 2) if line]
    table = _numbers(path, rows, MAP_HEADER)
    return table[:, :2], (table[:, 2] != 0).astype(np.uint8)


def _numbers(path: Path, rows: Iterable[tuple[int, list[str]]], form: str) -> FloatArray:
    """(N, columns) of rows of cells with their line number; `form` names the columns as the file parts them."""
    columns = len(form.replace(",", " ").split())
    table = []
    for number, cells in rows:
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        if len(values) != columns or not all(map(isfinite, values)):
            raise RunFolderError(f"{path} line {number} must hold the numbers {form}.")
        table.append(values)
    return np.array(table, dtype=np.float64).reshape(-1, columns)


def write_json(path: Path, content: object) -> None:
    """Indented, as people read it; replaces the file."""
    write_atomically(path, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())


def read_pois(path: Path) -> list[dict[str, Any]]:
    """The records of a pois.json, each with place and texts as they should be; none when there is no such file."""
    if not path.exists():
        return []
    content = load_json(path, str(path), RunFolderError)
    if not isinstance(content, list):
        raise RunFolderError(f"{path} must hold a list of records.")
    nodes = [Node(record, str(path), RunFolderError, f"[{i}]") for i, record in enumerate(content)]
    return [record | _checked(poi) for record, poi in zip(content, nodes, strict=True)]


def _checked(poi: Node) -> dict[str, Any]:
    """What readers rely on, of one record."""
    known: dict[str, Any] = {name: poi.text(name) for name in filter(poi.has, _POI_TEXTS)}
    if poi.has("poi_id"):
        known["poi_id"] = poi.whole("poi_id")
    return known | {name: poi.number(name) for name in ("x_m", "y_m")}


def read_zones(path: Path) -> tuple[Zone, ...]:
    """No-go lines and areas as they counted last; none when there is no such file."""
    if not path.exists():
        return ()
    try:
        return of_json(load_json(path, str(path), RunFolderError))
    except ValueError as error:
        raise RunFolderError(f"{path}: {error}") from error


def files_of_run(run_dir: Path) -> list[str]:
    """Which of RECORDED_NAMES the folder holds."""
    return [name for name in RECORDED_NAMES if (run_dir / name).exists()]


def read_path(run_dir: Path) -> tuple[FloatArray, FloatArray]:
    """Times (K,) and poses (K, 3) of the smoothed trajectory, where there is none of the one as it was published."""
    # The one of every pose grows without end: it is read only where it is needed
    for name in (SMOOTHED_NAME, TRAJECTORY_NAME):
        file = run_dir / name
        times_s, poses = read_tum(file) if file.exists() else (np.empty(0), np.empty((0, 3)))
        if len(times_s):
            near = _on_floor(file, poses[:, :2])
            return times_s[near], poses[near]
    return np.empty(0), np.empty((0, 3))


def read_map(run_dir: Path) -> MapData:
    """What the folder knows of the map. What lies on no floor is left out, with a warning."""
    points_m, inferred = np.empty((0, 2)), np.empty(0, np.uint8)
    file = run_dir / MAP_POINTS_NAME
    if file.exists():
        points_m, inferred = read_map_points(file)
        near = _on_floor(file, points_m)
        points_m, inferred = points_m[near], inferred[near]
    pois = read_pois(run_dir / POIS_NAME)
    near = _on_floor(run_dir / POIS_NAME, np.array([(poi["x_m"], poi["y_m"]) for poi in pois]).reshape(-1, 2))
    near_pois = [pois[k] for k in np.flatnonzero(near)]
    return MapData(points_m, inferred, read_path(run_dir)[1], near_pois, read_zones(run_dir / ZONES_NAME))


def on_floor(places_m: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    """(N,) which of the places (N, 2) lie within MAP_REACH_M."""
    return np.asarray(np.abs(places_m).max(axis=1, initial=0.0) <= MAP_REACH_M)


def _on_floor(file: Path, places_m: Points) -> npt.NDArray[np.bool_]:
    """As `on_floor`, with a warning where some do not."""
    near = on_floor(places_m)
    if not near.all():
        _log.warning(
            "%s: %d of %d places lie more than %g m from the start and are left out.",
            *(file, np.count_nonzero(~near), len(near), MAP_REACH_M),
        )
    return near
