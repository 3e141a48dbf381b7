"""The map's pictures: their scale, their base point, and what they show; and the registry of formats."""

from __future__ import annotations

import io
from math import radians
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from deploy.cli import main
from offboard.export import formats, map_picture
from offboard.export.formats import EXPORTS, ExportError, export
from offboard.export.map_picture import PIXELS_PER_MM, as_png, as_svg
from offboard.export.plan import Plan, make_plan
from offboard.export.sheet import Sheet, single_sheet
from offboard.export.title import TitleBlock
from offboard.export.wall_lines import DRAWN_MAX, STRAIGHT_M, simplify, thin, wall_lines
from offboard.runs import run_folder
from offboard.runs.run_folder import MapData
from tests.unit.export_scenes import HALL_M, hall, write_run

SVG = "{http://www.w3.org/2000/svg}"
NAMED = TitleBlock("Ground floor", "IT Building, Łódź", date="2026-11-30 19:40")


def nothing() -> MapData:
    return MapData(np.empty((0, 2)), np.empty(0, np.uint8), np.empty((0, 3)))


def sheet(data: MapData, block: TitleBlock = NAMED) -> Sheet:
    return single_sheet(make_plan(data), block)


def drawn(plan: Plan, name: str) -> list[np.ndarray]:
    return [line for stroke in plan.strokes if stroke.name == name for line in stroke.lines]


def words(data: MapData, block: TitleBlock = NAMED) -> set[str]:
    return {text.text for text in sheet(data, block).texts}


@pytest.mark.requirement("VSL_MR_04")
def test_a_wall_of_ten_metres_is_ten_centimetres_long_in_the_svg() -> None:
    root = ElementTree.fromstring(as_svg(hall()))
    size = sheet(hall())
    assert (root.get("width"), root.get("height")) == (f"{size.width_mm:g}mm", f"{size.height_mm:g}mm")
    assert root.get("viewBox") == f"0 0 {size.width_mm:g} {size.height_mm:g}"
    (wall,) = drawn(make_plan(hall()), "walls")
    assert wall[:, 0].max() - wall[:, 0].min() == pytest.approx(10 * HALL_M, abs=0.1)


@pytest.mark.requirement("VSL_MR_03")
def test_base_point_is_the_lower_left_corner_of_the_plan() -> None:
    plan = make_plan(hall())
    assert plan.x0_m <= -1.0
    assert plan.y0_m <= -2.0
    description = ElementTree.fromstring(as_svg(hall())).findtext(f"{SVG}desc")
    assert description is not None
    assert f"x {plan.x0_m:g} m, y {plan.y0_m:g} m" in description
    (wall,) = drawn(plan, "walls")
    np.testing.assert_allclose(wall[:, 1], (-1.0 - plan.y0_m) * 10, atol=0.1)


@pytest.mark.requirement("VSL_MR_04")
def test_door_is_an_asterisk_with_its_number_and_room_type() -> None:
    root = ElementTree.fromstring(as_svg(hall()))
    asterisk = root.find(f"{SVG}path[@class='pois']")
    assert asterisk is not None
    assert asterisk.get("d", "").count("M") == 3
    assert {"1<2", "Lab"} <= {text.text for text in root.iter(f"{SVG}text")}
    assert [title.text for title in root.iter(f"{SVG}title")] == ["Door 1<2 Lab"]


def test_number_and_room_type_stand_on_the_far_side_of_the_wall() -> None:
    plan = make_plan(hall())
    wall_mm = (-1.0 - plan.y0_m) * 10
    assert all(text.y_mm < wall_mm - 2.0 for text in plan.texts)


def test_a_sheet_has_title_building_date_scale_and_legend() -> None:
    there = words(hall())
    assert {"Ground floor", "IT Building, Łódź", "wall", "wall, inferred", "start heading", "5 m"} <= there
    assert any("2026-11-30 19:40" in text and "1:100" in text for text in there)
    assert any("date not recorded" in text for text in words(hall(), TitleBlock()))


def test_north_is_drawn_only_where_somebody_entered_the_bearing() -> None:
    assert "N" not in words(hall())
    turned = TitleBlock(bearing_rad=radians(90.0))  # the robot started towards the east: north is to its left, up
    assert "N" in words(hall(), turned)
    (outline,) = next(stroke.lines for stroke in sheet(hall(), turned).strokes if stroke.name == "north")
    assert np.ptp(outline[:, 1]) == pytest.approx(10.0, abs=0.1)
    assert np.count_nonzero(outline[:, 1] > outline[:, 1].max() - 0.01) == 1  # its tip is up, its tail has two corners


def test_inferred_walls_are_dashed_in_both_pictures() -> None:
    root = ElementTree.fromstring(as_svg(hall()))
    inferred = root.find(f"{SVG}path[@class='inferred']")
    assert inferred is not None
    assert inferred.get("stroke-dasharray")
    plan = make_plan(hall())
    pixels = np.asarray(Image.open(io.BytesIO(as_png(hall()))).convert("L"))
    row = pixels.shape[0] - round((10 + 32 + (1.0 - plan.y0_m) * 10) * PIXELS_PER_MM)
    left = round((10 - plan.x0_m * 10) * PIXELS_PER_MM)
    dark = pixels[row, left + 10 : left + round(9.0 * 10 * PIXELS_PER_MM)] < 200
    assert np.count_nonzero(np.diff(dark.astype(int)) == 1) > 20


def test_up_in_the_map_is_up_in_the_pictures() -> None:
    data = hall()
    above = MapData(np.array([[5.0, 30.0]]), np.zeros(1, np.uint8), data.trajectory)
    image = Image.open(io.BytesIO(as_png(above))).convert("L")
    rows = np.flatnonzero((np.asarray(image) < 60).any(axis=1))
    assert rows.min() < image.height * 0.12


def test_png_has_at_least_150_dots_per_inch_and_its_size_on_paper() -> None:
    image = Image.open(io.BytesIO(as_png(hall())))
    size = sheet(hall())
    assert image.info["dpi"][0] >= 150.0
    printed_mm = [pixels / dpi * 25.4 for pixels, dpi in zip(image.size, image.info["dpi"], strict=True)]
    assert printed_mm == pytest.approx([size.width_mm, size.height_mm], abs=0.2)


def test_a_map_that_is_too_large_is_drawn_coarser_with_a_warning_that_names_the_pdf(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_picture, "IMAGE_PIXELS_MAX", 200_000)
    image = Image.open(io.BytesIO(as_png(hall())))
    assert image.width * image.height == pytest.approx(200_000, rel=0.01)
    assert "print the PDF" in caplog.text


def test_empty_run_is_an_empty_sheet() -> None:
    ElementTree.fromstring(as_svg(nothing()))
    assert as_png(nothing()).startswith(b"\x89PNG")


def test_a_title_that_is_too_long_is_made_smaller_and_then_cut() -> None:
    long = TitleBlock("Ground floor of the building " * 6)
    (shown,) = [text for text in sheet(hall(), long).texts if text.text.startswith("Ground floor")]
    assert shown.text.endswith("…")
    assert len(shown.text) * shown.height_mm * 0.58 < 60.0


def test_near_wall_points_are_joined_and_far_ones_are_not() -> None:
    lines = wall_lines(np.array([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0], [0.9, 0.0]]))
    ends = sorted((round(min(line[:, 0]), 2), round(max(line[:, 0]), 2)) for line in lines)
    assert ends == [(0.0, 0.4), (0.9, 0.9)]


def test_a_noisy_wall_with_a_corner_is_two_lines_and_no_branches() -> None:
    along = np.arange(0.0, 8.0, 0.05)
    corner = np.concatenate([np.column_stack([along, 0 * along]), np.column_stack([0 * along + 8.0, along])])
    noisy = corner + np.random.default_rng(1).normal(0.0, 0.012, corner.shape)
    (line,) = wall_lines(noisy)
    assert len(line) < len(noisy) / 20
    assert float(np.hypot(*np.diff(line, axis=0).T).sum()) == pytest.approx(16.0, abs=0.2)


def test_a_simplified_line_passes_every_point_as_near_as_it_promises() -> None:
    xs = np.linspace(0.0, 10.0, 200)
    line = np.column_stack([xs, np.sin(xs)])
    few = simplify(line, STRAIGHT_M)
    dense = np.column_stack(
        [np.interp(np.linspace(0, 1, 5000), np.linspace(0, 1, len(few)), few[:, k]) for k in (0, 1)]
    )
    assert len(few) < 60
    assert cKDTree(dense).query(line)[0].max() < STRAIGHT_M + 0.005


def test_thinning_keeps_one_point_per_place() -> None:
    points = np.repeat(np.array([[0.01, 0.01], [1.01, 0.01]]), 50, axis=0)
    np.testing.assert_allclose(thin(points), [[0.01, 0.01], [1.01, 0.01]])


def test_a_map_of_any_number_of_points_is_drawn_with_a_bounded_number() -> None:
    points = np.random.default_rng(1).uniform(-300.0, 300.0, (120_000, 2))
    thinned = thin(points)
    assert DRAWN_MAX / 10 < len(thinned) <= DRAWN_MAX
    assert cKDTree(thinned).query(points)[0].max() < 5.0


def test_export_writes_the_pictures_of_a_run_folder(tmp_path: Path) -> None:
    run, out = write_run(tmp_path / "run", hall()), tmp_path / "out"
    assert export(run, out, ["svg", "png"]) == [out / "map.svg", out / "map.png"]
    assert (out / "map.svg").read_text() == as_svg(run_folder.read_map(run))


def test_the_verb_puts_what_a_person_entered_into_the_title_block(tmp_path: Path) -> None:
    run, out = write_run(tmp_path / "run", hall()), tmp_path / "out"
    entered = ["--building", "IT Building", "--bearing", "45", "--format", "svg"]
    assert main(["export", str(run), "--to", str(out), *entered]) == 0
    there = {text.text for text in ElementTree.parse(out / "map.svg").iter(f"{SVG}text")}
    assert {"run", "IT Building", "N", "bearing 45°"} <= there


def test_a_file_where_an_export_needs_a_folder_is_named_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, taken = write_run(tmp_path / "run", hall()), tmp_path / "taken"
    taken.touch()
    assert main(["export", str(run), "--to", str(taken), "--format", "svg"]) != 0
    assert capsys.readouterr().err == f"indoor-mapping: {taken}: File exists.\n"


def test_the_date_of_a_sheet_is_the_day_on_which_the_run_began(recorded_run: Path, tmp_path: Path) -> None:
    export(recorded_run, tmp_path, ["svg"])
    assert f"{formats.title(recorded_run).date}   scale 1:100" in (tmp_path / "map.svg").read_text()


def test_every_format_is_made_of_a_whole_run_and_of_one_without_a_database_what_can_be(
    recorded_run: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = {file.name for file in export(recorded_run, tmp_path / "whole")}
    assert {"map.pdf", "map.svg", "map.dxf", "map.geojson", "doors.csv", "areas.csv", "run.mcap", "ros2_bag"} < whole
    assert not caplog.records
    part = {file.name for file in export(write_run(tmp_path / "run", hall()), tmp_path / "part")}
    assert {"map.pdf", "map.dxf", "map.geojson"} < part
    assert "run.mcap" not in part
    assert "no run.sqlite, which the format 'mcap'" in caplog.text


def test_a_format_whose_package_is_missing_is_refused_in_a_sentence_and_left_out_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    run = write_run(tmp_path / "run", hall())
    monkeypatch.setattr(formats, "find_spec", lambda package: None if package == "ezdxf" else object())
    with pytest.raises(ExportError, match=r"'dxf' needs the Python package ezdxf: \./deploy/local\.sh --setup-only"):
        export(run, tmp_path / "one", ["svg", "dxf"])
    assert not (tmp_path / "one").exists()
    assert "map.dxf" not in {file.name for file in export(run, tmp_path / "all")}
    assert "needs the Python package ezdxf" in caplog.text


def test_unknown_format_and_missing_run_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=f"no export format 'dwg'; choose from {', '.join(EXPORTS)}"):
        export(tmp_path, tmp_path, ["dwg"])
    with pytest.raises(ExportError, match="no run folder at"):
        export(tmp_path / "none", tmp_path, ["svg"])
