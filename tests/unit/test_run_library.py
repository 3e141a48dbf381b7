"""Recorded runs as pages: the list with pictures and figures, each run at its address, two over each other."""

from __future__ import annotations

import io
import json
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from offboard.runs import run_folder
from offboard.runs.run_folder import MapData
from offboard.visualizer import run_library
from offboard.visualizer.run_library import RunLibrary
from offboard.visualizer.server import PageServer
from offboard.visualizer.thumbnail import SIZE, thumbnail
from tests.page_socket import page_socket


def record(folder: Path, length_m: float = 8.0) -> None:
    """A hall, driven along once."""
    folder.mkdir(parents=True)
    xs = np.arange(0.0, length_m, 0.1)
    walls = np.concatenate([np.column_stack([xs, np.full(len(xs), y)]) for y in (-1.25, 1.25)])
    run_folder.write_map_points(folder / run_folder.MAP_POINTS_NAME, walls, np.zeros(len(walls), np.uint8))
    path = np.column_stack([np.linspace(0.0, length_m, 61), np.zeros(61), np.zeros(61)])
    for name in (run_folder.TRAJECTORY_NAME, run_folder.SMOOTHED_NAME):
        run_folder.write_tum(folder / name, np.arange(61.0), path)
    summary = {"floor": "loop", "simulated_time_s": 754.0, "outcome": "finished", "coverage": 0.973, "home_m": 0.08}
    run_folder.write_json(folder / run_folder.SUMMARY_NAME, summary)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    for name in ("monday", "tuesday", "über 9 #?"):
        record(tmp_path / "runs" / name)
    record(tmp_path / "elsewhere")
    (tmp_path / "runs" / "notes").mkdir()
    made = PageServer(RunLibrary(tmp_path / "runs"), "127.0.0.1", 0)
    made.start()
    yield made
    made.close()


def get(server: PageServer, path: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(server.address + path, timeout=5) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def test_the_list_has_every_run_with_its_figures_and_the_page(server: PageServer) -> None:
    assert b"<title>Recorded runs" in get(server, "")[1]
    runs: list[dict[str, Any]] = json.loads(get(server, "runs.json")[1])["runs"]
    assert sorted(run["name"] for run in runs) == ["monday", "tuesday", "über 9 #?"]
    assert (runs[0]["floor"], runs[0]["duration"], runs[0]["end"]) == ("loop", "12:34 min", "finished, and home")
    assert runs[0]["figures"] == {"Coverage": "97 %", "Off home": "0.080 m"}


@pytest.mark.parametrize("name", ["monday", "%C3%BCber%209%20%23%3F"])
def test_each_run_has_its_page_photos_and_exports_at_its_own_address(server: PageServer, name: str) -> None:
    assert b"<title>Indoor Mapping</title>" in get(server, f"run/{name}/")[1]
    assert get(server, f"run/{name}/export/map.csv")[1].startswith(b"x_m,y_m,inferred")
    with page_socket(f"{server.address}run/{name}/") as page:
        hello, _ = page.of_channel("hello")
        assert (hello["recorded"] != "", hello["over"]) == (True, "")
        assert page.of_channel("map")[0]["total"] == 160


def test_nothing_but_the_runs_of_that_folder_is_served(server: PageServer) -> None:
    for name in ("wednesday", "notes", "..%2Felsewhere", "..", "%00", "monday%2F..%2Ftuesday"):
        assert get(server, f"run/{name}/export/map.csv")[0] == 404, name
        assert get(server, f"thumbnails/{name}.png")[0] == 404, name


def test_another_run_lies_over_one(server: PageServer) -> None:
    with page_socket(f"{server.address}over/monday/tuesday/") as page:
        assert page.of_channel("hello")[0]["over"] == "tuesday"
    compared = json.loads(get(server, "over/monday/tuesday/comparison")[1])
    assert compared["text"].startswith("100 % of the walls that both saw agree; moved 0.00 m")
    assert len(compared["layers"]["common"]) == 2 * 160
    assert get(server, "run/monday/comparison")[0] == 404


def test_runs_that_nobody_looks_at_make_room_for_others(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_library, "OPEN_MAX", 1)
    with page_socket(f"{server.address}run/monday/") as page:
        page.next(5.0)
        status, why = get(server, "run/tuesday/")
        assert (status, why.startswith(b"1 runs are open")) == (404, True)
    for _ in range(100):
        if get(server, "run/tuesday/")[0] == 200:
            break
    assert get(server, "run/tuesday/")[0] == 200


def test_a_thumbnail_shows_walls_path_and_doors() -> None:
    walls = np.column_stack([np.arange(0.0, 8.0, 0.1), np.zeros(80)])
    path = np.array([[0.0, 1.0, 0.0], [8.0, 1.0, 0.0]])
    picture = Image.open(
        io.BytesIO(thumbnail(MapData(walls, np.zeros(80, np.uint8), path, [{"x_m": 4.0, "y_m": 0.0}])))
    )
    assert picture.size == SIZE
    pixels = np.asarray(picture.convert("RGBA")).reshape(-1, 4)
    solid = pixels[pixels[:, 3] > 200].astype(int)
    assert len(solid[solid[:, 0] > solid[:, 2] + 60]) > 10, "the door is red"
    assert len(solid[solid[:, 2] > solid[:, 0] + 60]) > 300, "the path is blue"
    assert thumbnail(MapData(np.empty((0, 2)), np.empty(0, np.uint8), np.empty((0, 3)))).startswith(b"\x89PNG")
