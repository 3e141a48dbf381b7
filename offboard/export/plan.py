"""The map as lines and letters at a scale of 1:100: map data -> `Plan`, which every drawing shows.

Everything is in millimetres on paper, y up, from the base point: the plan's lower left corner (VSL_MR_03, VSL_MR_04).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, cos, hypot, sin
from typing import Any

import numpy as np
import numpy.typing as npt

from common.geometry import FloatArray, Points
from common.plain_text import plain
from common.zones import Zone, ZoneKind
from offboard.export.drawing_bounds import drawing_bounds
from offboard.export.wall_lines import wall_lines
from offboard.export.zone_lines import border_in
from offboard.runs.run_folder import MapData

MM_PER_M = 10.0  # 1:100
TRAIL_STEP_M = 0.05
GRID_M = 5.0
TEXT_MAX = 60  # letters

GRID, BORDER, WALL, INFERRED, TRAIL = "#e4e8ec", "#9aa5b1", "#1f2933", "#7b8794", "#5b9bd5"
ZONE, ZONE_DASH_MM = "#b7610b", (3.0, 1.2)
START, POI, TEXT = "#2f855a", "#c53030", "#3e4c59"
INFERRED_DASH_MM = (1.6, 1.4)
ASTERISK_MM, START_MM, NUMBER_MM, ROOM_TYPE_MM = 2.0, 2.2, 2.5, 1.8  # 1.8 is the smallest that ISO 3098 knows


@dataclass(frozen=True, slots=True)
class Stroke:
    """Polylines (N, 2) of one look, or closed shapes where `filled`. `dash_mm`: lengths of dash and gap."""

    name: str
    lines: list[Points]
    colour: str
    width_mm: float
    dash_mm: tuple[float, float] | None = None
    filled: bool = False

    def moved(self, x_mm: float, y_mm: float) -> Stroke:
        return replace(self, lines=[line + (x_mm, y_mm) for line in self.lines])


@dataclass(frozen=True, slots=True)
class Text:
    """One line; its baseline begins, has its middle or ends at the place, as `anchor` names it (SVG's words)."""

    x_mm: float
    y_mm: float
    text: str
    colour: str = TEXT
    height_mm: float = NUMBER_MM  # of the font
    anchor: str = "start"

    def moved(self, x_mm: float, y_mm: float) -> Text:
        return replace(self, x_mm=self.x_mm + x_mm, y_mm=self.y_mm + y_mm)


@dataclass(frozen=True, slots=True)
class Plan:
    """What to draw, from the back to the front."""

    x0_m: float  # the base point in the map
    y0_m: float
    width_mm: float
    height_mm: float
    strokes: list[Stroke]
    texts: list[Text]
    hints: list[Text]  # for programs that show a hint at a place


def make_plan(data: MapData) -> Plan:
    pois_m = np.array([(poi["x_m"], poi["y_m"]) for poi in data.pois], np.float64).reshape(-1, 2)
    x0_m, y0_m, width_m, height_m = drawing_bounds((data.points_m, data.trajectory[:, :2], pois_m))

    def on_paper(lines_m: list[Points]) -> list[Points]:
        return [(line - (x0_m, y0_m)) * MM_PER_M for line in lines_m]

    width_mm, height_mm = width_m * MM_PER_M, height_m * MM_PER_M
    borders = [(zone, border_in(zone, (x0_m, y0_m, x0_m + width_m, y0_m + height_m))) for zone in data.zones]
    borders = [(zone, on_paper(lines)) for zone, lines in borders if lines]
    (path,) = on_paper([trail(data.trajectory)])
    places = on_paper([pois_m])[0]
    echoed = data.inferred == 0
    strokes = [
        Stroke("grid", _grid(x0_m, y0_m, width_mm, height_mm), GRID, 0.2),
        *(_border(zone, lines) for zone, lines in borders),
        Stroke("trail", [path] if len(path) > 1 else [], TRAIL, 0.5),
        inferred_walls(on_paper(wall_lines(data.points_m[~echoed]))),
        Stroke("walls", on_paper(wall_lines(data.points_m[echoed])), WALL, 0.9),
        Stroke("start", [_arrow_head(path[0], data.trajectory[0, 2])] if len(path) else [], START, 0.0, filled=True),
        Stroke("pois", [line for place in places for line in asterisk(*place)], POI, 0.7),
    ]
    labels = [label for poi, place in zip(data.pois, places, strict=True) for label in _labels(poi, place, path)]
    labels += [_title(zone, lines[0].mean(axis=0)) for zone, lines in borders]
    hints = [Text(float(x), float(y), _hint(poi)) for poi, (x, y) in zip(data.pois, places, strict=True)]
    return Plan(x0_m, y0_m, width_mm, height_mm, strokes, labels, hints)


def _border(zone: Zone, lines: list[Points]) -> Stroke:
    """What a person drew; dashed where the robot stays inside of it."""
    return Stroke("zones", lines, ZONE, 0.6, ZONE_DASH_MM if zone.kind is ZoneKind.ONLY else None)


def _title(zone: Zone, at: Points) -> Text:
    return Text(float(at[0]), float(at[1]), zone.title, ZONE, ROOM_TYPE_MM)


def inferred_walls(lines: list[Points]) -> Stroke:
    """Walls that no sonar echoed from, dashed in every drawing."""
    return Stroke("inferred", lines, INFERRED, 0.7, INFERRED_DASH_MM)


def trail(trajectory: FloatArray) -> Points:
    """The path (N, 2), no two points nearer than TRAIL_STEP_M."""
    kept: list[npt.NDArray[np.float64]] = []
    for point in trajectory[:, :2]:
        if not kept or hypot(*(point - kept[-1])) >= TRAIL_STEP_M:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def rectangle(x_mm: float, y_mm: float, width_mm: float, height_mm: float) -> Points:
    return np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * (width_mm, height_mm) + (x_mm, y_mm)


def asterisk(x_mm: float, y_mm: float) -> list[Points]:
    angles = np.arange(3) * np.pi / 3 + np.pi / 2
    return [np.outer((-ASTERISK_MM, ASTERISK_MM), (cos(a), sin(a))) + np.array([x_mm, y_mm]) for a in angles]


def _grid(x0_m: float, y0_m: float, width_mm: float, height_mm: float) -> list[Points]:
    """Lines at whole multiples of GRID_M of the map's own coordinates."""
    xs = (np.arange(ceil(x0_m / GRID_M) * GRID_M, x0_m + width_mm / MM_PER_M, GRID_M) - x0_m) * MM_PER_M
    ys = (np.arange(ceil(y0_m / GRID_M) * GRID_M, y0_m + height_mm / MM_PER_M, GRID_M) - y0_m) * MM_PER_M
    upright = [np.array([[x, 0.0], [x, height_mm]]) for x in xs]
    return upright + [np.array([[0.0, y], [width_mm, y]]) for y in ys]


def _arrow_head(at: Points, heading_rad: float) -> Points:
    c, s = cos(heading_rad), sin(heading_rad)
    corners = np.array([(1.6, 0.0), (-1.0, 1.0), (-0.5, 0.0), (-1.0, -1.0)])
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) * START_MM + at)


def _labels(poi: dict[str, Any], place: Points, path: Points) -> list[Text]:
    """Number and room type, on the far side of the wall: away from where the robot drove."""
    away = np.array([0.0, 1.0])
    if len(path):
        offset = place - path[np.hypot(*(path - place).T).argmin()]
        away = offset / hypot(*offset) if hypot(*offset) > 1e-6 else away
    number, room_type = text_of(poi, "number") or "?", room_of(poi)
    lines = [(number, NUMBER_MM), *([(room_type, ROOM_TYPE_MM)] if room_type else [])]
    height_mm = 1.2 * sum(size for _, size in lines)
    half_width_mm = max(0.28 * size * len(text) for text, size in lines)
    x_mm, y_mm = place + away * (ASTERISK_MM + 0.8) + away * np.array([half_width_mm, height_mm / 2])
    texts, top_mm = [], y_mm + height_mm / 2
    for text, size in lines:
        top_mm -= 1.2 * size
        texts.append(Text(float(x_mm), float(top_mm + 0.35 * size), text, POI, size, "middle"))
    return texts


def text_of(poi: dict[str, Any], key: str) -> str:
    """A text of a record, on one line, as drawings can hold it."""
    return plain(str(poi.get(key) or ""), TEXT_MAX)


def room_of(poi: dict[str, Any]) -> str:
    """What the room behind a door is called: by a person, else by its plate."""
    return text_of(poi, "room_name") or text_of(poi, "room_type")


def _hint(poi: dict[str, Any]) -> str:
    return " ".join(text_of(poi, key) for key in ("name", "number", "room_type", "room_name")).strip()
