"""The map as DXF (R2018) for CAD: map data -> a drawing in metres of the map, letters as high as on paper at 1:100.

Layers: `walls`, `inferred` (dashed), `doors` (a point each), `text`, `no-go` (lines and areas that a person drew).
"""

from __future__ import annotations

import io
from math import degrees, hypot
from typing import Any

import ezdxf.filemanagement
import numpy as np
from ezdxf.enums import TextEntityAlignment
from ezdxf.layouts.layout import Modelspace

from common.geometry import Points
from offboard.export.plan import INFERRED_DASH_MM, MM_PER_M, NUMBER_MM, ROOM_TYPE_MM, room_of, text_of
from offboard.export.title import TitleBlock
from offboard.export.wall_lines import wall_lines
from offboard.export.zone_lines import outline
from offboard.runs.run_folder import MapData

_RED, _GREEN, _GREY, _BLACK, _ORANGE = 1, 3, 8, 7, 30  # AutoCAD's colour index; 7 is black on white paper
_DASH_M, _GAP_M = (length / MM_PER_M for length in INFERRED_DASH_MM)


def as_dxf(data: MapData, block: TitleBlock) -> bytes:
    document = ezdxf.filemanagement.new("R2018", units=ezdxf.units.M)
    document.header["$MEASUREMENT"] = 1
    document.linetypes.add("INFERRED", [_DASH_M + _GAP_M, _DASH_M, -_GAP_M], description="inferred __  __  __")
    for layer, colour, linetype in (
        ("walls", _BLACK, "CONTINUOUS"),
        ("inferred", _GREY, "INFERRED"),
        ("doors", _RED, "CONTINUOUS"),
        ("text", _RED, "CONTINUOUS"),
        ("no-go", _ORANGE, "CONTINUOUS"),
    ):
        document.layers.add(layer, color=colour, linetype=linetype)
    space = document.modelspace()
    for layer, mark in (("walls", 0), ("inferred", 1)):
        _lines(space, layer, wall_lines(data.points_m[data.inferred == mark]))
    for poi in data.pois:
        _door(space, poi)
    for zone in data.zones:
        _lines(space, "no-go", [outline(zone)])
    if len(data.trajectory):
        _start(space, data.trajectory[0].tolist(), block)
    document.set_modelspace_vport(max(10.0, 1.2 * _height_m(data)), center=_middle(data))
    text = io.StringIO()
    document.write(text)
    return text.getvalue().encode("utf-8", "surrogateescape")


def _lines(space: Modelspace, layer: str, lines_m: list[Points]) -> None:
    for line in lines_m:
        if hypot(*(line[-1] - line[0])) > 0.0 or len(line) > 2:
            space.add_lwpolyline(line.tolist(), dxfattribs={"layer": layer})
        else:
            space.add_point((*line[0].tolist(), 0.0), dxfattribs={"layer": layer})


def _door(space: Modelspace, poi: dict[str, Any]) -> None:
    at = np.array([poi["x_m"], poi["y_m"]], dtype=np.float64)
    space.add_point((*at.tolist(), 0.0), dxfattribs={"layer": "doors"})
    rows = (
        (text_of(poi, "number") or "?", NUMBER_MM, 0.05),
        (room_of(poi), ROOM_TYPE_MM, -0.25),
    )
    for text, height_mm, up_m in rows:
        if text:
            entity = space.add_text(text, height=height_mm / MM_PER_M, dxfattribs={"layer": "text"})
            entity.set_placement((float(at[0]) + 0.1, float(at[1]) + up_m), align=TextEntityAlignment.LEFT)


def _start(space: Modelspace, pose: list[float], block: TitleBlock) -> None:
    x_m, y_m, heading_rad = pose
    attributes = {"layer": "text", "color": _GREEN, "rotation": degrees(heading_rad)}
    note = "start heading" if block.north_rad is None else f"start heading, bearing {degrees(block.north_rad):.0f}"
    text = space.add_text(f"-> {note}", height=NUMBER_MM / MM_PER_M, dxfattribs=attributes)
    text.set_placement((x_m, y_m), align=TextEntityAlignment.LEFT)


def _corners(data: MapData) -> Points:
    return np.concatenate([data.points_m, data.trajectory[:, :2], np.zeros((1, 2))])


def _middle(data: MapData) -> tuple[float, float]:
    low, high = _corners(data).min(axis=0), _corners(data).max(axis=0)
    x_m, y_m = ((low + high) / 2).tolist()
    return x_m, y_m


def _height_m(data: MapData) -> float:
    return float(np.ptp(_corners(data), axis=0).max())
