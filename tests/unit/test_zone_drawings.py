"""What a person drew stands in every drawing, and blows none up."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest

from common.zones import Zone, ZoneKind
from offboard.command_center.places import UnknownPlace
from offboard.command_center.zone_text import zone_order
from offboard.export.dxf_plan import as_dxf
from offboard.export.geojson import as_geojson
from offboard.export.map_picture import as_svg
from offboard.export.plan import make_plan
from offboard.export.title import TitleBlock
from offboard.export.zone_lines import border_in
from offboard.runs import run_folder
from offboard.runs.run_folder import RunFolderError
from tests.unit.export_scenes import hall

LINE = Zone(1, ZoneKind.LINE, ((4.0, -1.0), (4.0, 1.0)))
HUGE = Zone(2, ZoneKind.ONLY, ((-400.0, -0.8), (400.0, -0.8), (400.0, 400.0), (-400.0, 400.0)))


def test_a_border_is_cut_at_the_sheet_and_a_huge_area_does_not_make_it_larger() -> None:
    bare, drawn = make_plan(hall()), make_plan(replace(hall(), zones=(LINE, HUGE)))
    assert (drawn.width_mm, drawn.height_mm) == (bare.width_mm, bare.height_mm)
    line, area = (stroke for stroke in drawn.strokes if stroke.name == "zones")
    assert np.ptp(line.lines[0], axis=0).tolist() == pytest.approx([0.0, 20.0])
    assert len(area.lines) == 1
    assert np.ptp(area.lines[0], axis=0).tolist() == pytest.approx([drawn.width_mm, 0.0])
    assert area.dash_mm
    assert "no-go line 1" in [text.text for text in drawn.texts]
    assert 'class="zones"' in as_svg(replace(hall(), zones=(LINE,)))


def test_a_side_beside_the_sheet_is_not_drawn() -> None:
    assert border_in(Zone(1, ZoneKind.LINE, ((5.0, 0.0), (5.0, 9.0))), (0.0, 0.0, 4.0, 4.0)) == []
    assert border_in(Zone(1, ZoneKind.LINE, ((5.0, 3.0), (3.0, 5.1))), (0.0, 0.0, 4.0, 4.0)) == []


def test_cad_and_map_programs_get_them_as_they_were_drawn() -> None:
    data = replace(hall(), zones=(LINE, HUGE))
    drawing = ezdxf.filemanagement.read(io.StringIO(as_dxf(data, TitleBlock()).decode()))
    lines = list(drawing.modelspace().query('LWPOLYLINE[layer=="no-go"]'))
    assert [len(line) for line in lines] == [2, 5]
    features = json.loads(as_geojson(data, [], TitleBlock()))["features"]
    shapes = {f["properties"]["robot"]: f["geometry"] for f in features if "robot" in f["properties"]}
    assert shapes["no-go-line"]["coordinates"] == [[4.0, -1.0], [4.0, 1.0]]
    (ring,) = shapes["only-here"]["coordinates"]
    assert ring[0] == ring[-1]


@pytest.mark.parametrize(
    "text", ["{", "{}", '[{"number": 1}]', '[{"number": 1, "kind": "no-go-line", "corners_m": []}]']
)
def test_a_damaged_file_of_them_is_named_in_a_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / run_folder.ZONES_NAME).write_text(text, encoding="utf-8")
    with pytest.raises(RunFolderError, match=run_folder.ZONES_NAME):
        run_folder.read_zones(tmp_path / run_folder.ZONES_NAME)


@pytest.mark.parametrize(
    "text", ["", "line", "line 1,1", "area 1,1 2,2", "line 1,1 2", "wall 1,1 2,2", "remove -1", "remove"]
)
def test_what_is_typed_wrongly_is_refused_with_a_sentence(text: str) -> None:
    with pytest.raises(UnknownPlace, match=r"\.$"):
        zone_order(text.split())


def test_all_are_removed_by_one_word() -> None:
    assert zone_order(["remove", "all"]).zone == 0
    assert zone_order(["Line", "-3,1", "4,1"]).corners_m == ((-3.0, 1.0), (4.0, 1.0))
