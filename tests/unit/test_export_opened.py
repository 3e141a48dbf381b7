"""Drawings and data of an export, opened by poppler, librsvg, GDAL, ezdxf, shapely, and by the rules of ROS."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from math import cos, radians, sin
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import yaml
from PIL import Image
from shapely.geometry import Point, shape

from offboard.export.formats import export
from offboard.export.map_picture import as_svg
from offboard.export.occupancy_image import CELL_M
from offboard.export.plan import make_plan
from offboard.export.sheet import BLOCK_MM, MARGIN_MM
from offboard.export.tiles import OVERLAP_MM, layout
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import MAP_POINTS_NAME, MapData, read_map_points
from tests.unit.export_scenes import HALL_M, hall, run_tool, write_run

pyogrio = pytest.importorskip("pyogrio")

PIXELS_PER_MM = 5
DPI = 127


def exported(tmp_path: Path, name: str, data: MapData, **entered: Any) -> Path:
    """The first file of this format."""
    return export(write_run(tmp_path / "run", data), tmp_path / "out", [name], TitleBlock(**entered))[0]


def pages_mm(pdf: Path) -> list[tuple[float, float]]:
    """Width and height of every page, as pdfinfo reads them."""
    said = run_tool("poppler-utils", "pdfinfo", "-l", "999", pdf)
    return [
        (float(w) / 72 * 25.4, float(h) / 72 * 25.4)
        for w, h in re.findall(r"Page +\d+ size: +([\d.]+) x ([\d.]+) pts", said)
    ]


def page_text(pdf: Path, page: int) -> str:
    return run_tool("poppler-utils", "pdftotext", "-layout", "-f", str(page), "-l", str(page), pdf, "-")


def rendered(pdf: Path, page: int) -> np.ndarray:
    stem = pdf.with_suffix("")
    run_tool("poppler-utils", "pdftoppm", "-r", str(DPI), "-f", str(page), "-l", str(page), "-singlefile", pdf, stem)
    return walls_of(Image.open(stem.with_suffix(".ppm")))


def walls_of(image: Image.Image) -> np.ndarray:
    """(rows, columns) where it shows the colour of walls, or darker."""
    return np.asarray(image.convert("L")) < 60


def plan_part(page: np.ndarray) -> np.ndarray:
    """Without the title block at its foot."""
    return page[: -round((MARGIN_MM + BLOCK_MM + 1.0) * PIXELS_PER_MM)]


def test_a_small_plan_is_one_page_of_a4_and_its_wall_has_the_right_length_within_half_a_millimetre(
    tmp_path: Path,
) -> None:
    pdf = exported(tmp_path, "pdf", hall(), title="Hall", building="IT Building")
    assert pages_mm(pdf) == [pytest.approx((210.0, 297.0), abs=0.01)]
    columns = np.flatnonzero(plan_part(rendered(pdf, 1)).any(axis=0))
    width_mm = 0.9  # of the line, whose round ends reach beyond the wall
    assert (columns[-1] - columns[0] + 1) / PIXELS_PER_MM == pytest.approx(10 * HALL_M + width_mm, abs=0.5)
    words = page_text(pdf, 1)
    assert all(word in words for word in ("Hall", "IT Building", "scale 1:100", "page 1 of 1", "1<2", "Lab"))


def test_an_inferred_wall_is_dashed_on_the_page(tmp_path: Path) -> None:
    """The upper one of the hall's two is, and grey."""
    pdf = exported(tmp_path, "pdf", hall())
    stem = pdf.with_suffix("")
    run_tool("poppler-utils", "pdftoppm", "-r", str(DPI), "-singlefile", pdf, stem)
    grey = plan_part(np.asarray(Image.open(stem.with_suffix(".ppm")).convert("L")))
    along = np.flatnonzero(walls_of(Image.fromarray(grey)).any(axis=0))
    shares = (grey[:, along[0] : along[-1] + 1] < 200).mean(axis=1)  # of the walls' length, by rows
    frame = np.flatnonzero(grey[:, along[0] - 2] < 200)  # its lines reach beyond the walls
    drawn = np.delete(shares, frame)
    assert drawn.max() > 0.95, "the wall that was echoed has no gap"
    assert len(drawn[(drawn > 0.4) & (drawn < 0.85)]) >= 2


def test_a_large_plan_is_an_overview_and_tiles_at_1_to_100_that_overlap_and_name_their_neighbours(
    tmp_path: Path,
) -> None:
    data = hall(60.0)
    pdf = exported(tmp_path, "pdf", data, paper="a3")
    tiles = layout(make_plan(data), "a3").tiles
    assert [tile.name for tile in tiles] == ["A1", "A2"]
    assert pages_mm(pdf) == 3 * [pytest.approx((420.0, 297.0), abs=0.01)]
    assert all(word in page_text(pdf, 1) for word in ("scale 1:200", "overview, page 1 of 3", "10 m"))
    assert "scale 1:100" not in page_text(pdf, 1)
    assert "overlaps page 3" in page_text(pdf, 2)
    assert "overlaps page 2" in page_text(pdf, 3)
    first, second = (np.flatnonzero(plan_part(rendered(pdf, page)).any(axis=0)) / PIXELS_PER_MM for page in (2, 3))
    # Where the plan ends on the first sheet is OVERLAP_MM behind where it begins on the second
    assert first[-1] == pytest.approx(420.0 - MARGIN_MM, abs=0.2)
    assert second[0] == pytest.approx(MARGIN_MM, abs=0.2)
    both_mm = (first[-1] - first[0]) + (second[-1] - second[0]) + 2 / PIXELS_PER_MM - OVERLAP_MM
    assert both_mm == pytest.approx(600.0 + 0.9, abs=0.5)


def test_pages_that_show_nothing_are_left_out() -> None:
    """An L of two long halls: the corner that they enclose is on no page."""
    along = np.arange(0.0, 90.0, 0.1)
    points = np.concatenate([np.column_stack([along, 0 * along]), np.column_stack([0 * along, along])])
    tiles = layout(make_plan(MapData(points, np.zeros(len(points), np.uint8), np.empty((0, 3)))), "a4").tiles
    rows, columns = {tile.row for tile in tiles}, {tile.column for tile in tiles}
    assert len(rows) > 2
    assert len(columns) > 2
    assert len(tiles) == len(rows) + len(columns) - 1


def test_svg_is_as_large_in_librsvg_as_it_should_be_and_its_wall_too(tmp_path: Path) -> None:
    svg = exported(tmp_path, "svg", hall(60.0))
    png = tmp_path / "svg.png"
    run_tool("librsvg2-bin", "rsvg-convert", "-d", str(DPI), "-p", str(DPI), svg, "-o", png)
    image = Image.open(png)
    (width,) = re.findall(r'width="([\d.]+)mm"', as_svg(hall(60.0)))
    assert image.width / PIXELS_PER_MM == pytest.approx(float(width), abs=0.2)
    columns = np.flatnonzero(plan_part(walls_of(image)).any(axis=0))
    assert (columns[-1] - columns[0] + 1) / PIXELS_PER_MM == pytest.approx(600.0 + 0.9, abs=0.5)


def test_dxf_passes_the_audit_in_metres_with_layers_and_letters_as_on_paper(tmp_path: Path) -> None:
    drawing = ezdxf.readfile(exported(tmp_path, "dxf", hall()))
    assert drawing.dxfversion == "AC1032"
    assert drawing.audit().errors == []
    assert drawing.header["$INSUNITS"] == 6
    space = drawing.modelspace()
    assert {entity.dxf.layer for entity in space} == {"walls", "inferred", "doors", "text"}
    assert drawing.layers.get("inferred").dxf.linetype == "INFERRED"
    heights = {text.dxf.text: text.dxf.height for text in space.query("TEXT")}
    assert heights["1<2"] == pytest.approx(0.25)
    assert heights["Lab"] == pytest.approx(0.18)
    (door,) = space.query("POINT[layer=='doors']")
    assert tuple(door.dxf.location)[:2] == (3.0, -1.0)


def test_gdal_reads_walls_of_the_right_length_from_the_dxf(tmp_path: Path) -> None:
    file = exported(tmp_path, "dxf", hall())
    _, _, geometry, (layers,) = pyogrio.raw.read(file, columns=["Layer"])
    from shapely import from_wkb

    lengths_m: dict[str, float] = {}
    for layer, line in zip(layers, from_wkb(geometry), strict=True):
        lengths_m[layer] = lengths_m.get(layer, 0.0) + line.length
    assert lengths_m["walls"] == pytest.approx(HALL_M, abs=0.05)
    assert lengths_m["inferred"] == pytest.approx(HALL_M, abs=0.05)


NARROW_Y_M = 0.5  # where a run without sonars knows the floor up to the walls


def numbered(*numbers: str) -> MapData:
    """A narrow hall with a door per number."""
    pois = [{"x_m": 1.0 + 2 * k, "y_m": -0.5, "number": n, "room_type": "Office"} for k, n in enumerate(numbers)]
    data = hall(y_m=NARROW_Y_M)
    return MapData(data.points_m, data.inferred, data.trajectory, pois)


def test_room_numbers_stay_text_in_geojson_for_gdal(tmp_path: Path) -> None:
    numbers = ["1.1", "1.10", "1e3", "205"]
    file = exported(tmp_path, "geojson", numbered(*numbers))
    info = pyogrio.read_info(file)
    assert dict(zip(info["fields"], info["dtypes"], strict=True))["ref"] == "object"
    _, _, _, (refs,) = pyogrio.raw.read(file, columns=["ref"])
    assert [ref for ref in refs if ref is not None] == numbers


def test_geojson_has_halls_walls_and_doors_with_indoor_tags_that_shapely_finds_valid(tmp_path: Path) -> None:
    features = json.loads(exported(tmp_path, "geojson", hall(y_m=NARROW_Y_M), level="2").read_text())["features"]
    shapes = [(feature["properties"], shape(feature["geometry"])) for feature in features]
    assert all(geometry.is_valid for _, geometry in shapes)
    assert {tags["level"] for tags, _ in shapes} == {"2"}
    ((tags, corridor),) = [(tags, geometry) for tags, geometry in shapes if tags.get("indoor") == "corridor"]
    assert corridor.exterior.is_ccw
    assert corridor.area == pytest.approx(tags["area_m2"], abs=0.01)
    walls_m = sum(geometry.length for tags, geometry in shapes if tags.get("indoor") == "wall")
    assert walls_m == pytest.approx(2 * HALL_M, abs=0.1)
    ((tags, door),) = [(tags, geometry) for tags, geometry in shapes if "door" in tags]
    assert tags | {"ref": "1<2", "room": "lab", "name": "Lab 1<2"} == tags
    assert door == Point(3.0, -NARROW_Y_M)


def test_gdal_takes_geojson_in_metres_for_metres(tmp_path: Path) -> None:
    crs = pyogrio.read_info(exported(tmp_path, "geojson", hall()))["crs"]
    assert crs is None or "4326" not in crs


def test_with_place_and_bearing_geojson_is_in_degrees(tmp_path: Path) -> None:
    """Ten metres north-east of the start, by a sphere's length of a degree there."""
    anchor, bearing_rad = (48.0, 11.0), radians(45.0)
    file = exported(tmp_path, "geojson", hall(), anchor_deg=anchor, bearing_rad=bearing_rad)
    assert "4326" in pyogrio.read_info(file)["crs"]
    features = json.loads(file.read_text())["features"]
    ((longitude, latitude),) = [f["geometry"]["coordinates"] for f in features if "door" in f["properties"]]
    east_m = 3.0 * sin(bearing_rad) + 1.0 * cos(bearing_rad)
    north_m = 3.0 * cos(bearing_rad) - 1.0 * sin(bearing_rad)
    assert (latitude - anchor[0]) * 111_194 == pytest.approx(north_m, rel=0.005)
    assert (longitude - anchor[1]) * 111_194 * cos(radians(48.0)) == pytest.approx(east_m, rel=0.005)


def test_tables_list_doors_and_areas_and_a_room_that_nobody_entered_has_none(tmp_path: Path) -> None:
    out = exported(tmp_path, "tables", numbered("1.10", "1.1")).parent
    doors = list(csv.DictReader(io.StringIO((out / "doors.csv").read_text())))
    assert [door["number"] for door in doors] == ["1.10", "1.1"]
    assert (doors[0]["x_m"], doors[0]["y_m"], doors[0]["space"]) == ("1.0", "-0.5", "hall 1")
    hall_row, *rooms = csv.DictReader(io.StringIO((out / "areas.csv").read_text()))
    assert float(hall_row["area_m2"]) == pytest.approx(2 * NARROW_Y_M * HALL_M, rel=0.1)
    assert hall_row["doors"] == "1.10 1.1"
    assert [(room["space"], room["kind"], room["area_m2"]) for room in rooms] == [
        ("Office 1.10", "room", ""),
        ("Office 1.1", "room", ""),
    ]


def map_server(yaml_file: Path) -> tuple[np.ndarray, float, list[float]]:
    """An occupancy grid as nav2's map_server makes it of mode trinary: -1 unknown, 0 free, 100 occupied."""
    settings = yaml.safe_load(yaml_file.read_text())
    shade = np.asarray(Image.open(yaml_file.parent / settings["image"])) / 255.0
    occupancy = shade if settings["negate"] else 1.0 - shade
    cells = np.full(shade.shape, -1)
    cells[occupancy > settings["occupied_thresh"]] = 100
    cells[occupancy < settings["free_thresh"]] = 0
    return cells[::-1], settings["resolution"], settings["origin"]


def test_map_server_reads_walls_free_floor_and_unknown_where_they_are(tmp_path: Path) -> None:
    image = exported(tmp_path, "pgm", hall())
    cells, resolution, (x_m, y_m, yaw) = map_server(image.with_suffix(".yaml"))
    assert (resolution, yaw) == (CELL_M, 0.0)

    def around(x: float, y: float) -> set[int]:
        column, row = int((x - x_m) / resolution), int((y - y_m) / resolution)
        return set(cells[row - 1 : row + 2, column - 1 : column + 2].ravel().tolist())

    assert around(5.0, 0.0) == {0}
    assert 100 in around(5.0, -1.0)
    assert around(5.0, -1.5) == {-1}


def test_a_wall_point_on_the_border_of_two_cells_is_in_the_one_where_a_map_server_looks(tmp_path: Path) -> None:
    data = hall()
    image = exported(tmp_path, "pgm", replace(data, points_m=data.points_m - (1.05, 0.0)))
    cells, resolution, origin = map_server(image.with_suffix(".yaml"))
    points_m, _ = read_map_points(tmp_path / "run" / MAP_POINTS_NAME)
    columns, rows = np.floor((points_m - origin[:2]) / resolution).astype(int).T
    assert (cells[rows, columns] == 100).all()
