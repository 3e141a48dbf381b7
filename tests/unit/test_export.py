"""The map's pictures: their scale, their base point, and what they show."""

from __future__ import annotations

import io
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from offboard.export.formats import ExportError, export
from offboard.export.map_picture import (
    DRAWN_MAX,
    IMAGE_SIDE_MAX_PX,
    PIXELS_PER_M,
    as_png,
    as_svg,
    draw,
    join,
    thin,
)
from offboard.runs import run_folder
from offboard.runs.run_folder import MapData

SVG = "{http://www.w3.org/2000/svg}"


def hall(length_m: float = 10.0) -> MapData:
    """Two walls, the upper one inferred, and one door."""
    xs = np.arange(0.0, length_m, 0.1)
    points = np.concatenate([np.column_stack([xs, np.full(len(xs), y)]) for y in (-1.0, 1.0)])
    inferred = np.repeat(np.array([0, 1], np.uint8), len(xs))
    path = np.column_stack([xs, np.zeros(len(xs)), np.zeros(len(xs))])
    poi = {"x_m": 3.0, "y_m": -1.0, "name": "Door", "number": "1<2", "room_type": "Lab"}
    return MapData(points, inferred, path, [poi])


def nothing() -> MapData:
    return MapData(np.empty((0, 2)), np.empty(0, np.uint8), np.empty((0, 3)))


@pytest.mark.requirement("VSL_MR_04")
def test_svg_is_one_centimetre_for_one_metre() -> None:
    root = ElementTree.fromstring(as_svg(hall()))
    drawing = draw(hall())
    assert root.get("width") == f"{drawing.width_m:g}cm"
    assert root.get("height") == f"{drawing.height_m:g}cm"
    assert root.get("viewBox") == f"0 0 {drawing.width_m * 10:g} {drawing.height_m * 10:g}"
    assert 10 < drawing.width_m < 16


@pytest.mark.requirement("VSL_MR_03")
def test_base_point_is_the_lower_left_corner() -> None:
    drawing = draw(hall())
    base = next(line for line in drawing.lines if line.name == "base").strokes[0][:-1]
    np.testing.assert_allclose(base.mean(axis=0), [drawing.x0_m, drawing.y0_m], atol=1e-9)
    assert drawing.x0_m <= -1.0
    assert drawing.y0_m <= -2.0
    title = ElementTree.fromstring(as_svg(hall())).findtext(f"{SVG}desc")
    assert title is not None
    assert f"x {drawing.x0_m:g} m, y {drawing.y0_m:g} m" in title


@pytest.mark.requirement("VSL_MR_04")
def test_door_is_an_asterisk_with_its_number() -> None:
    root = ElementTree.fromstring(as_svg(hall()))
    asterisk = root.find(f"{SVG}path[@id='pois']")
    assert asterisk is not None
    assert asterisk.get("d", "").count("M") == 3
    assert "1<2" in [text.text for text in root.iter(f"{SVG}text")]
    assert [title.text for title in root.iter(f"{SVG}title")] == ["Door 1<2 Lab"]


def test_number_stands_on_the_far_side_of_the_wall() -> None:
    (label,) = [label for label in draw(hall()).labels if label.text == "1<2"]
    assert label.y_m < -1.3


def test_up_in_the_map_is_up_in_the_pictures() -> None:
    data = hall()
    above = MapData(np.array([[5.0, 30.0]]), np.zeros(1, np.uint8), data.trajectory)
    image = Image.open(io.BytesIO(as_png(above))).convert("L")
    rows = np.flatnonzero((np.asarray(image) < 60).any(axis=1))
    assert rows.min() < image.height * 0.1


def test_png_has_twenty_pixels_per_metre_and_is_not_blank() -> None:
    image = Image.open(io.BytesIO(as_png(hall())))
    drawing = draw(hall())
    assert image.size == (drawing.width_m * PIXELS_PER_M, drawing.height_m * PIXELS_PER_M)
    assert len(image.convert("RGB").getcolors(1 << 24) or []) > 10


def test_huge_map_is_drawn_smaller() -> None:
    far = MapData(np.array([[0.0, 0.0], [500.0, 3.0]]), np.zeros(2, np.uint8), np.empty((0, 3)))
    image = Image.open(io.BytesIO(as_png(far)))
    assert max(image.size) == IMAGE_SIDE_MAX_PX


def test_empty_run_is_an_empty_sheet() -> None:
    ElementTree.fromstring(as_svg(nothing()))
    assert as_png(nothing()).startswith(b"\x89PNG")


def test_near_wall_points_are_joined_and_far_ones_are_not() -> None:
    strokes = join(np.array([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0], [0.9, 0.0]]))
    ends = sorted((round(min(s[:, 0]), 2), round(max(s[:, 0]), 2)) for s in strokes)
    assert ends == [(0.0, 0.2), (0.2, 0.4), (0.9, 0.9)]


def test_thinning_keeps_one_point_per_place() -> None:
    points = np.repeat(np.array([[0.01, 0.01], [1.01, 0.01]]), 50, axis=0)
    np.testing.assert_allclose(thin(points), [[0.01, 0.01], [1.01, 0.01]])


def test_a_map_of_any_number_of_points_is_drawn_with_a_bounded_number() -> None:
    points = np.random.default_rng(1).uniform(-300.0, 300.0, (120_000, 2))
    drawn = thin(points)
    assert DRAWN_MAX / 10 < len(drawn) <= DRAWN_MAX
    assert cKDTree(drawn).query(points)[0].max() < 5.0


def test_export_writes_the_pictures_of_a_run_folder(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "out"
    run.mkdir()
    data = hall()
    run_folder.write_map_points(run / run_folder.MAP_POINTS_NAME, data.points_m, data.inferred)
    run_folder.write_tum(run / run_folder.TRAJECTORY_NAME, np.arange(len(data.trajectory)) * 1.0, data.trajectory)
    run_folder.write_json(run / run_folder.POIS_NAME, data.pois)
    assert export(run, out, ["svg", "png"]) == [out / "map.svg", out / "map.png"]
    assert (out / "map.svg").read_text() == as_svg(run_folder.read_map(run))


def test_unknown_format_and_missing_run_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="no export format 'dxf'; choose from svg, png"):
        export(tmp_path, tmp_path, ["dxf"])
    with pytest.raises(ExportError, match="no run folder at"):
        export(tmp_path / "none", tmp_path, ["svg"])
