"""A hall that every export is made of, and the programs that open what came of it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from offboard.runs import run_folder
from offboard.runs.run_folder import MapData

HALL_M = 10.0


def hall(length_m: float = HALL_M, y_m: float = 1.0) -> MapData:
    """Two walls, the upper one inferred, and one door in the lower one."""
    xs = np.arange(0.0, length_m + 1e-6, 0.1)
    points = np.concatenate([np.column_stack([xs, np.full(len(xs), y)]) for y in (-y_m, y_m)])
    inferred = np.repeat(np.array([0, 1], np.uint8), len(xs))
    path = np.column_stack([xs, np.zeros(len(xs)), np.zeros(len(xs))])
    poi = {"x_m": 3.0, "y_m": -y_m, "name": "Door", "number": "1<2", "room_type": "Lab"}
    return MapData(points, inferred, path, [poi])


def write_run(folder: Path, data: MapData) -> Path:
    """A run folder without a database."""
    folder.mkdir(parents=True, exist_ok=True)
    run_folder.write_map_points(folder / run_folder.MAP_POINTS_NAME, data.points_m, data.inferred)
    run_folder.write_tum(folder / run_folder.TRAJECTORY_NAME, np.arange(len(data.trajectory)) * 1.0, data.trajectory)
    run_folder.write_json(folder / run_folder.POIS_NAME, data.pois)
    return folder


def run_tool(package: str, *command: str | Path) -> str:
    """Its output; the test is skipped where the program is not there."""
    if shutil.which(str(command[0])) is None:
        pytest.skip(f"needs: apt install {package}")
    return subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True, timeout=60).stdout
