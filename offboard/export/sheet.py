"""The plan on a sheet of paper: title, building, date, legend, scale bar, start heading. `Plan` -> `Sheet`.

Everything is in millimetres, y up, from the sheet's lower left corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, degrees, sin

import numpy as np

from common.geometry import Points
from offboard.export.plan import (
    BORDER,
    INFERRED,
    INFERRED_DASH_MM,
    POI,
    START,
    TEXT,
    TRAIL,
    WALL,
    Plan,
    Stroke,
    Text,
    asterisk,
    rectangle,
)
from offboard.export.title import TitleBlock

MARGIN_MM = 10.0  # what printers leave white
BLOCK_MM = 30.0  # height of the title block
BLOCK_WIDTH_MIN_MM = 180.0
SCALE_BAR_M, BAR_PARTS = 5.0, 5
_TITLE_WIDTH_MM, _LEGEND_WIDTH_MM = 62.0, 62.0
_LETTER = 0.58  # width of a letter over the height of its font


@dataclass(frozen=True, slots=True)
class Sheet:
    width_mm: float
    height_mm: float
    strokes: list[Stroke]
    texts: list[Text]
    hints: list[Text]
    description: str


def single_sheet(plan: Plan, block: TitleBlock) -> Sheet:
    """The whole plan on one sheet that is as large as it must be."""
    inner_mm = max(plan.width_mm, BLOCK_WIDTH_MIN_MM)
    x_mm, y_mm = MARGIN_MM, MARGIN_MM + BLOCK_MM + 2.0
    block_strokes, block_texts = title_block(plan, block, inner_mm)
    return Sheet(
        inner_mm + 2 * MARGIN_MM,
        y_mm + plan.height_mm + MARGIN_MM,
        [
            *(stroke.moved(x_mm, y_mm) for stroke in [*plan.strokes, *frame(plan)]),
            *(stroke.moved(MARGIN_MM, MARGIN_MM) for stroke in block_strokes),
        ],
        [
            *(text.moved(x_mm, y_mm) for text in plan.texts),
            *(text.moved(MARGIN_MM, MARGIN_MM) for text in block_texts),
        ],
        [hint.moved(x_mm, y_mm) for hint in plan.hints],
        f"{block.title}. 1 cm for 1 m; {base_point(plan)}",
    )


def base_point(plan: Plan) -> str:
    return f"base point (lower left) at x {plan.x0_m:g} m, y {plan.y0_m:g} m of the map"


def frame(plan: Plan) -> list[Stroke]:
    """The plan's border, and its base point."""
    angle = np.linspace(0, 2 * np.pi, 25)
    return [
        Stroke("border", [rectangle(0.0, 0.0, plan.width_mm, plan.height_mm)], BORDER, 0.35),
        Stroke("base", [2.0 * np.column_stack([np.cos(angle), np.sin(angle)])], BORDER, 0.0, filled=True),
    ]


def title_block(
    plan: Plan, block: TitleBlock, width_mm: float, page: str = "", scale: int = 100
) -> tuple[list[Stroke], list[Text]]:
    """From (0, 0) on, `width_mm` wide and BLOCK_MM high; `page`: its number; `scale`: the drawing is 1 : this."""
    strokes = [Stroke("block", [rectangle(0.0, 0.0, width_mm, BLOCK_MM)], BORDER, 0.35)]
    texts = _words(plan, block, f"scale 1:{scale}", page)
    legend_strokes, legend_texts = _legend(_TITLE_WIDTH_MM + 3.0)
    bar_strokes, bar_texts = _scale_bar(_TITLE_WIDTH_MM + _LEGEND_WIDTH_MM + 4.0, 5.0, scale)
    arrow_strokes, arrow_texts = _arrows(block, _TITLE_WIDTH_MM + _LEGEND_WIDTH_MM + 8.0, 20.0)
    return [*strokes, *legend_strokes, *bar_strokes, *arrow_strokes], [
        *texts,
        *legend_texts,
        *bar_texts,
        *arrow_texts,
    ]


def _words(plan: Plan, block: TitleBlock, scale: str, page: str) -> list[Text]:
    date = block.date or "date not recorded"
    rows = [
        (block.title, 5.0, 22.5),
        (block.building, 3.5, 16.5),
        (f"{date}   {scale}", 2.5, 12.0),
        (base_point(plan), 2.0, 8.0),
        (page, 2.5, 3.0),
    ]
    return [_fitted(Text(3.0, y_mm, text, TEXT, height_mm), _TITLE_WIDTH_MM - 4.0) for text, height_mm, y_mm in rows]


def _fitted(text: Text, width_mm: float) -> Text:
    """In smaller letters, then cut, where it is wider than `width_mm`."""
    if len(text.text) * text.height_mm * _LETTER <= width_mm:
        return text
    height_mm = max(1.8, width_mm / (_LETTER * len(text.text)))
    letters = int(width_mm / (_LETTER * height_mm) + 1e-6)
    shown = text.text if len(text.text) <= letters else text.text[: letters - 1] + "…"
    return Text(text.x_mm, text.y_mm, shown, text.colour, height_mm, text.anchor)


def _legend(x_mm: float) -> tuple[list[Stroke], list[Text]]:
    def sample(row: int) -> Points:
        y_mm = BLOCK_MM - 5.0 - 4.6 * row
        return np.array([[x_mm, y_mm], [x_mm + 9.0, y_mm]])

    strokes = [
        Stroke("legend", [sample(0)], WALL, 0.9),
        Stroke("legend", [sample(1)], INFERRED, 0.7, INFERRED_DASH_MM),
        Stroke("legend", [sample(2)], TRAIL, 0.5),
        Stroke("legend", asterisk(x_mm + 4.5, sample(3)[0, 1]), POI, 0.7),
        Stroke("legend", [arrow(sample(4)[0], 0.0, 9.0)], START, 0.0, filled=True),
    ]
    words = ("wall", "wall, inferred", "path of the robot", "door: number, room type", "start, and its heading")
    texts = [Text(x_mm + 12.0, float(sample(row)[0, 1]) - 0.9, word) for row, word in enumerate(words)]
    return strokes, texts


def _scale_bar(x_mm: float, y_mm: float, scale: int) -> tuple[list[Stroke], list[Text]]:
    """Five parts, black and white in turn, of as many metres as make it about 50 mm long."""
    part_m = ceil(scale / 100 * SCALE_BAR_M / BAR_PARTS)
    part_mm = part_m * 1000 / scale
    parts = [rectangle(x_mm + k * part_mm, y_mm, part_mm, 1.6) for k in range(BAR_PARTS)]
    strokes = [
        Stroke("scale", parts[::2], TEXT, 0.0, filled=True),
        Stroke("scale-frame", [rectangle(x_mm, y_mm, BAR_PARTS * part_mm, 1.6)], TEXT, 0.2),
    ]
    marks = [
        Text(x_mm + k * part_mm, y_mm - 3.0, f"{k * part_m} m" if k else "0", anchor="middle") for k in (0, BAR_PARTS)
    ]
    return strokes, marks


def _arrows(block: TitleBlock, x_mm: float, y_mm: float) -> tuple[list[Stroke], list[Text]]:
    """Of the start heading, which points to the right of every drawing; of north only where somebody entered it."""
    strokes = [Stroke("heading", [arrow(np.array([x_mm, y_mm]), 0.0, 14.0)], START, 0.0, filled=True)]
    texts = [Text(x_mm - 3.0, y_mm - 5.5, "start heading")]
    if block.north_rad is None:
        return strokes, [*texts, Text(x_mm - 3.0, y_mm - 9.0, "(north was not entered)", height_mm=1.8)]
    middle, along = np.array([x_mm + 34.0, y_mm - 2.0]), np.array([cos(block.north_rad), sin(block.north_rad)])
    strokes.append(Stroke("north", [arrow(middle - 5.0 * along, block.north_rad, 10.0)], TEXT, 0.0, filled=True))
    bearing = Text(x_mm - 3.0, y_mm - 9.0, f"bearing {degrees(block.north_rad) % 360:.0f}°", height_mm=1.8)
    tip = middle + 7.0 * along
    return strokes, [*texts, bearing, Text(float(tip[0]), float(tip[1]) - 0.9, "N", anchor="middle")]


def arrow(tail: Points, direction_rad: float, length_mm: float) -> Points:
    """A closed outline from `tail` (2,)."""
    head_mm = 3.6
    corners = [(0.0, 0.25), (length_mm - head_mm, 0.25), (length_mm - head_mm, 1.3), (length_mm, 0.0)]
    outline = np.array([*corners, *((x, -y) for x, y in reversed(corners[:-1]))])
    c, s = cos(direction_rad), sin(direction_rad)
    return np.asarray(outline @ np.array([[c, s], [-s, c]]) + tail)
