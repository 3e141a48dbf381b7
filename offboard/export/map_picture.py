"""The map as a picture: run folder -> SVG (1 cm on paper for 1 m in the building) and PNG.

Both draw the same `Drawing`: wall points strokes where neighbours are near, the robot's trail, its start, an asterisk
and a number for each point of interest. The base point is the drawing's lower left corner, y up (VSL_MR_03, VSL_MR_04).
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from math import ceil, cos, hypot, sin
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from common.geometry import FloatArray, Points
from offboard.export.drawing_bounds import drawing_bounds
from offboard.runs.run_folder import MapData

JOIN_M = 0.25  # wall points nearer than this are one wall
THIN_M = 0.06  # of the points in a square of this side one is drawn
DRAWN_MAX = 100_000  # points: six kilometres of wall, drawn in a few seconds
TRAIL_STEP_M = 0.05
GRID_M = 5.0
UNITS_PER_M = 10.0  # of the SVG's own coordinates: millimetres on paper
PIXELS_PER_M = 20.0
IMAGE_SIDE_MAX_PX = 6000
OVERSAMPLING = 2

PAPER, GRID, BORDER = "#ffffff", "#eef1f4", "#9aa5b1"
WALL, INFERRED, TRAIL, START, POI, TEXT = "#1f2933", "#9aa5b1", "#5b9bd5", "#2f855a", "#c53030", "#3e4c59"
WALL_M, THIN_LINE_M, TRAIL_M, START_M, ASTERISK_M, TEXT_M = 0.11, 0.03, 0.06, 0.22, 0.24, 0.55


@dataclass(frozen=True, slots=True)
class Line:
    """Strokes of one look: polylines (N, 2) in metres, or a closed shape where `filled`."""

    name: str
    strokes: list[Points]
    colour: str
    width_m: float
    filled: bool = False


@dataclass(frozen=True, slots=True)
class Label:
    x_m: float
    y_m: float  # of the middle of the letters
    text: str
    colour: str


@dataclass(frozen=True, slots=True)
class Drawing:
    """What to draw, from the back to the front, inside a border."""

    x0_m: float  # the base point: lower left corner of the border, in map coordinates
    y0_m: float
    width_m: float
    height_m: float
    lines: list[Line]
    labels: list[Label]


def thin(points_m: Points) -> Points:
    """One point, the mean, for every square of THIN_M that has any; larger squares where DRAWN_MAX would be passed."""
    side_m = THIN_M
    points_m = _means(points_m, side_m)
    while len(points_m) > DRAWN_MAX:
        side_m *= 2
        points_m = _means(points_m, side_m)
    return points_m


def _means(points_m: Points, side_m: float) -> Points:
    if not len(points_m):
        return points_m
    _, cell, count = np.unique(np.floor(points_m / side_m), axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    means = [np.bincount(cell, points_m[:, k]) / count for k in (0, 1)]
    return np.column_stack(means)


def join(points_m: Points) -> list[Points]:
    """Strokes that join neighbours nearer than JOIN_M, as few as keep the wall together; dots for the rest.

    The minimum spanning forest of the neighbourhood graph: walls stay lines where noise would draw a mesh.
    """
    if not len(points_m):
        return []
    pairs = cKDTree(points_m).query_pairs(JOIN_M, output_type="ndarray")
    lengths_m = np.hypot(*(points_m[pairs[:, 0]] - points_m[pairs[:, 1]]).T)
    graph = coo_array((lengths_m, (pairs[:, 0], pairs[:, 1])), shape=(len(points_m), len(points_m)))
    forest = minimum_spanning_tree(graph.tocsr()).tocoo()
    alone = np.setdiff1d(np.arange(len(points_m)), np.concatenate([forest.row, forest.col]))
    strokes = [points_m[[a, b]] for a, b in zip(forest.row, forest.col, strict=True)]
    return strokes + [points_m[[k, k]] for k in alone]


def trail(trajectory: FloatArray) -> Points:
    """The path (N, 2), no two points nearer than TRAIL_STEP_M."""
    kept: list[npt.NDArray[np.float64]] = []
    for point in trajectory[:, :2]:
        if not kept or hypot(*(point - kept[-1])) >= TRAIL_STEP_M:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _circle(x_m: float, y_m: float, radius_m: float) -> Points:
    angle = np.linspace(0, 2 * np.pi, 25)
    return np.column_stack([x_m + radius_m * np.cos(angle), y_m + radius_m * np.sin(angle)])


def _start_mark(trajectory: FloatArray) -> list[Points]:
    """An arrow head along the first heading."""
    x_m, y_m, heading_rad = trajectory[0]
    corners = [(1.6, 0.0), (-1.0, 1.0), (-0.5, 0.0), (-1.0, -1.0)]
    turned = [
        (a * cos(heading_rad) - b * sin(heading_rad), a * sin(heading_rad) + b * cos(heading_rad)) for a, b in corners
    ]
    return [np.array(turned) * START_M + (x_m, y_m)]


def _asterisk(x_m: float, y_m: float) -> list[Points]:
    angles = np.arange(3) * np.pi / 3 + np.pi / 2
    return [np.outer((-ASTERISK_M, ASTERISK_M), (cos(a), sin(a))) + np.array([x_m, y_m]) for a in angles]


def _poi_label(poi: dict[str, Any], path: Points) -> Label:
    """The number, on the far side of the wall: away from where the robot drove."""
    place = np.array([poi["x_m"], poi["y_m"]], dtype=np.float64)
    away = np.array([0.0, 1.0])
    if len(path):
        offset = place - path[np.hypot(*(path - place).T).argmin()]
        away = offset / hypot(*offset) if hypot(*offset) > 1e-6 else away
    text = str(poi.get("number") or "?")
    gap = ASTERISK_M + 0.1 + TEXT_M / 2 + abs(away[0]) * TEXT_M * 0.3 * (len(text) - 1)
    x_m, y_m = place + gap * away
    return Label(float(x_m), float(y_m), text, POI)


def _scale_bar(x0_m: float, y0_m: float) -> tuple[list[Line], list[Label]]:
    left, y = x0_m + 0.7, y0_m + 0.6
    ends = [np.array([[left + k, y - 0.12], [left + k, y + 0.12]]) for k in (0.0, GRID_M)]
    bar = Line("scale", [np.array([[left, y], [left + GRID_M, y]]), *ends], TEXT, 0.05)
    return [bar], [Label(left + GRID_M / 2, y + 0.45, f"{GRID_M:g} m", TEXT)]


def draw(data: MapData) -> Drawing:
    """Everything that either picture shows."""
    pois_m = np.array([(poi["x_m"], poi["y_m"]) for poi in data.pois], np.float64).reshape(-1, 2)
    x0_m, y0_m, width_m, height_m = drawing_bounds((data.points_m, data.trajectory[:, :2], pois_m))
    x1_m, y1_m = x0_m + width_m, y0_m + height_m
    path = trail(data.trajectory)
    echoed = data.inferred == 0
    grid = [np.array([[x, y0_m], [x, y1_m]]) for x in np.arange(ceil(x0_m / GRID_M) * GRID_M, x1_m, GRID_M)]
    grid += [np.array([[x0_m, y], [x1_m, y]]) for y in np.arange(ceil(y0_m / GRID_M) * GRID_M, y1_m, GRID_M)]
    border = np.array([[x0_m, y0_m], [x1_m, y0_m], [x1_m, y1_m], [x0_m, y1_m], [x0_m, y0_m]])
    bar_lines, bar_labels = _scale_bar(x0_m, y0_m)
    asterisks = [stroke for poi in data.pois for stroke in _asterisk(poi["x_m"], poi["y_m"])]
    lines = [
        Line("grid", grid, GRID, THIN_LINE_M),
        Line("trail", [path] if len(path) > 1 else [], TRAIL, TRAIL_M),
        Line("inferred", join(thin(data.points_m[~echoed])), INFERRED, WALL_M),
        Line("walls", join(thin(data.points_m[echoed])), WALL, WALL_M),
        Line("start", _start_mark(data.trajectory) if len(path) else [], START, 0.0, filled=True),
        Line("pois", asterisks, POI, 0.09),
        Line("border", [border], BORDER, 0.06),
        Line("base", [_circle(x0_m, y0_m, 0.25)], BORDER, 0.0, filled=True),
        *bar_lines,
    ]
    labels = [*bar_labels, *(_poi_label(poi, path) for poi in data.pois)]
    return Drawing(x0_m, y0_m, width_m, height_m, lines, labels)


def as_svg(data: MapData) -> str:
    """The map as SVG text, 1 cm for 1 m; the points of interest carry their name, number and room as a tooltip."""
    drawing = draw(data)
    width, height = drawing.width_m * UNITS_PER_M, drawing.height_m * UNITS_PER_M

    def place(x_m: float, y_m: float) -> tuple[float, float]:
        return (x_m - drawing.x0_m) * UNITS_PER_M, height - (y_m - drawing.y0_m) * UNITS_PER_M

    def path(stroke: Points, closed: bool) -> str:
        return "M" + "L".join("{:.2f} {:.2f}".format(*place(x, y)) for x, y in stroke) + ("Z" if closed else "")

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{drawing.width_m:g}cm" height="{drawing.height_m:g}cm" '
        f'viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" font-size="{TEXT_M * UNITS_PER_M:g}" '
        'stroke-linecap="round" stroke-linejoin="round" fill="none">',
        f"<desc>1 cm for 1 m; base point (lower left) at x {drawing.x0_m:g} m, y {drawing.y0_m:g} m of the map</desc>",
        f'<rect width="{width:g}" height="{height:g}" fill="{PAPER}"/>',
    ]
    for line in drawing.lines:
        paint = f'fill="{line.colour}"' if line.filled else f'stroke="{line.colour}"'
        shape = "".join(path(stroke, line.filled) for stroke in line.strokes)
        parts.append(f'<path id="{line.name}" {paint} stroke-width="{line.width_m * UNITS_PER_M:g}" d="{shape}"/>')
    for label in drawing.labels:
        x, y = place(label.x_m, label.y_m - TEXT_M * 0.36)
        at = f'x="{x:.2f}" y="{y:.2f}" fill="{label.colour}" text-anchor="middle"'
        parts.append(f"<text {at}>{escape(label.text)}</text>")
    for poi in data.pois:
        x, y = place(poi["x_m"], poi["y_m"])
        title = " ".join(str(poi.get(key) or "") for key in ("name", "number", "room_type")).strip()
        radius = 1.5 * ASTERISK_M * UNITS_PER_M
        parts.append(
            f'<circle class="poi" cx="{x:.2f}" cy="{y:.2f}" r="{radius:g}" fill="{PAPER}" fill-opacity="0">'
            f"<title>{escape(title)}</title></circle>"
        )
    return "\n".join([*parts, "</svg>", ""])


def as_png(data: MapData) -> bytes:
    """The map as PNG, PIXELS_PER_M unless a side would pass IMAGE_SIDE_MAX_PX; its resolution prints 1 cm for 1 m."""
    drawing = draw(data)
    scale_px = min(PIXELS_PER_M, IMAGE_SIDE_MAX_PX / max(drawing.width_m, drawing.height_m))
    size = round(drawing.width_m * scale_px), round(drawing.height_m * scale_px)
    fine = scale_px * OVERSAMPLING
    image = Image.new("RGB", (size[0] * OVERSAMPLING, size[1] * OVERSAMPLING), PAPER)
    brush = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=TEXT_M * fine)

    def place(points_m: Points) -> list[tuple[float, float]]:
        return [((x - drawing.x0_m) * fine, image.height - (y - drawing.y0_m) * fine) for x, y in points_m.tolist()]

    for line in drawing.lines:
        width = max(round(line.width_m * fine), 1)
        for stroke in map(place, line.strokes):
            if line.filled:
                brush.polygon(stroke, fill=line.colour)
                continue
            brush.line(stroke, fill=line.colour, width=width, joint="curve")
            for x, y in (stroke[0], stroke[-1]) if width > 2 else ():
                brush.ellipse((x - width / 2, y - width / 2, x + width / 2, y + width / 2), fill=line.colour)
    for label in drawing.labels:
        (at,) = place(np.array([[label.x_m, label.y_m]]))
        brush.text(at, label.text, fill=label.colour, font=font, anchor="mm")
    out = io.BytesIO()
    dpi = scale_px * 2.54
    image.resize(size, Image.Resampling.LANCZOS).save(out, "PNG", dpi=(dpi, dpi), optimize=True)
    return out.getvalue()
