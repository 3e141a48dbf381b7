"""All that is exported of one whole mission, opened by programs that are not ours. Slow: three minutes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from PIL import Image
from rosbags.rosbag2 import Reader
from shapely import from_wkb
from shapely.geometry import shape

from deploy.cli import main
from offboard.export.formats import EXPORTS
from offboard.runs.run_database import RunReader
from offboard.runs.run_folder import read_map_points
from tests.unit.export_scenes import run_tool

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
ezdxf = pytest.importorskip("ezdxf")
pyogrio = pytest.importorskip("pyogrio")
WALL_M = 0.2  # of a length of all walls, between two formats


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mission") / "run"
    assert main(["simulate", "--floor", "straight", "--seed", "1", "--camera", "clean", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def out(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports")
    assert main(["export", str(run), "--to", str(folder), "--paper", "a3"]) == 0
    return folder


def test_every_format_is_made_of_it(out: Path) -> None:
    assert len(list(out.iterdir())) > len(EXPORTS)


def test_every_page_of_the_pdf_has_the_papers_size(out: Path) -> None:
    said = run_tool("poppler-utils", "pdfinfo", "-l", "99", out / "map.pdf")
    sizes = {(float(w), float(h)) for w, h in re.findall(r"Page +\d+ size: +([\d.]+) x ([\d.]+) pts", said)}
    assert {tuple(sorted(round(side / 72 * 25.4) for side in size)) for size in sizes} == {(297, 420)}


def test_walls_are_as_long_in_the_dxf_for_gdal_and_ezdxf_as_in_the_geojson(out: Path) -> None:
    drawing = ezdxf.readfile(out / "map.dxf")
    assert drawing.audit().errors == []
    _, _, lines, (layers,) = pyogrio.raw.read(out / "map.dxf", columns=["Layer"])
    by_gdal_m = sum(line.length for layer, line in zip(layers, from_wkb(lines), strict=True) if layer == "walls")
    features = [
        (shape(feature["geometry"]), feature["properties"])
        for feature in json.loads((out / "map.geojson").read_text())["features"]
    ]
    assert all(geometry.is_valid for geometry, _ in features)
    assert pyogrio.read_info(out / "map.geojson")["features"] == len(features)
    geojson_m = sum(geometry.length for geometry, tags in features if tags.get("indoor") == "wall")
    inferred_m = sum(line.length for layer, line in zip(layers, from_wkb(lines), strict=True) if layer == "inferred")
    assert by_gdal_m > 40.0
    assert by_gdal_m + inferred_m == pytest.approx(geojson_m, abs=WALL_M)


def test_a_map_server_finds_a_wall_at_every_point_of_the_map(run: Path, out: Path) -> None:
    settings = yaml.safe_load((out / "map.yaml").read_text())
    shade = np.asarray(Image.open(out / settings["image"])) / 255.0
    occupied = (1.0 - shade > settings["occupied_thresh"])[::-1]
    free = (1.0 - shade < settings["free_thresh"])[::-1]
    points_m, _ = read_map_points(run / "map_points.csv")
    columns, rows = ((points_m - settings["origin"][:2]) / settings["resolution"]).astype(int).T
    assert occupied[rows, columns].all()
    assert 20.0 < free.sum() * settings["resolution"] ** 2 < 120.0


def test_log_and_bag_hold_every_pose_of_the_run(run: Path, out: Path) -> None:
    with RunReader(run) as reader:
        poses = reader.counts()["mmu/pose"]
    with (out / "run.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        of_topic = {channel.topic: number for number, channel in summary.channels.items()}
        assert summary.statistics.channel_message_counts[of_topic["/pose"]] == poses
    with Reader(out / "ros2_bag") as bag:
        assert {c.topic: c.msgcount for c in bag.connections}["/pose"] == poses
