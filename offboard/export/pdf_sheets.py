"""The sheet as PDF: map data and title block -> pages of A4 or A3 at exactly 1:100, for printers of offices.

A plan that fits one page is one page. Otherwise the first page shows the whole at a smaller scale, with the names of
the pages that follow; those overlap their neighbours by OVERLAP_MM, where they are marked.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas

from offboard.export.letters import font_file
from offboard.export.plan import Plan, Stroke, Text, make_plan, rectangle
from offboard.export.sheet import MARGIN_MM, frame, title_block
from offboard.export.tiles import OVERLAP_MM, Layout, Tile, crosses, layout, window_corner_mm
from offboard.export.title import TitleBlock
from offboard.runs.run_folder import MapData

POINTS_PER_MM = 72.0 / 25.4
MARK = "#b83280"
_FONT, _PLAN = "plan", "plan"


def as_pdf(data: MapData, block: TitleBlock) -> bytes:
    plan = make_plan(data)
    pages = layout(plan, block.paper)
    pdfmetrics.registerFont(TTFont(_FONT, font_file()))
    out = io.BytesIO()
    page_size = pages.page_width_mm * POINTS_PER_MM, pages.page_height_mm * POINTS_PER_MM
    canvas = Canvas(out, pagesize=page_size, invariant=1, pageCompression=1)
    canvas.setTitle(block.title)
    canvas.setSubject("1:100, to be printed at 100 %")
    _define_plan(canvas, plan)
    if len(pages.tiles) > 1:
        _overview(canvas, plan, block, pages)
    for number, tile in enumerate(pages.tiles):
        _tile(canvas, plan, block, pages, tile, number)
    canvas.save()
    return out.getvalue()


def _define_plan(canvas: Any, plan: Plan) -> None:
    """The plan once, for all pages: each shows its window of it."""
    width, height = plan.width_mm * POINTS_PER_MM, plan.height_mm * POINTS_PER_MM
    canvas.beginForm(_PLAN, -10, -10, width + 10, height + 10)
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    _paint(canvas, [*plan.strokes, *frame(plan)], plan.texts)
    canvas.endForm()


def _window(canvas: Any, pages: Layout, x_mm: float, y_mm: float, scale: float) -> None:
    """The plan from its place (x_mm, y_mm) on, in the page's window."""
    left_mm, low_mm = window_corner_mm()
    width_mm, height_mm = pages.window_mm
    canvas.saveState()
    clip = canvas.beginPath()
    clip.rect(*(length * POINTS_PER_MM for length in (left_mm, low_mm, width_mm, height_mm)))
    canvas.clipPath(clip, stroke=0, fill=0)
    canvas.translate((left_mm - x_mm * scale) * POINTS_PER_MM, (low_mm - y_mm * scale) * POINTS_PER_MM)
    canvas.scale(scale, scale)
    canvas.doForm(_PLAN)
    canvas.restoreState()


def _tile(canvas: Any, plan: Plan, block: TitleBlock, pages: Layout, tile: Tile, number: int) -> None:
    several = len(pages.tiles) > 1
    _window(canvas, pages, tile.x_mm, tile.y_mm, 1.0)
    page = f"sheet {tile.name}, page {number + 2} of {len(pages.tiles) + 1}" if several else "page 1 of 1"
    _block(canvas, plan, block, pages, page)
    if several:
        numbers = {(other.row, other.column): k + 2 for k, other in enumerate(pages.tiles)}
        _marks(canvas, plan, pages, tile, numbers)
    canvas.showPage()


def _overview(canvas: Any, plan: Plan, block: TitleBlock, pages: Layout) -> None:
    scale = pages.overview_scale(plan)
    _window(canvas, pages, 0.0, 0.0, 100 / scale)
    x_mm, y_mm = window_corner_mm()
    width_mm, height_mm = (100 / scale * length for length in pages.window_mm)
    strokes, texts = [], []
    for tile in pages.tiles:
        left_mm, low_mm = x_mm + 100 / scale * tile.x_mm, y_mm + 100 / scale * tile.y_mm
        strokes.append(Stroke("tile", [rectangle(left_mm, low_mm, width_mm, height_mm)], MARK, 0.2, (1.2, 1.2)))
        texts.append(Text(left_mm + 2.0, low_mm + height_mm - 5.0, tile.name, MARK, 4.0))
    _scaled(canvas, strokes, texts, pages)
    _block(canvas, plan, block, pages, f"overview, page 1 of {len(pages.tiles) + 1}", scale)
    canvas.showPage()


def _block(canvas: Any, plan: Plan, block: TitleBlock, pages: Layout, page: str, scale: int = 100) -> None:
    strokes, texts = title_block(plan, block, pages.window_mm[0], page, scale)
    _scaled(
        canvas,
        [stroke.moved(MARGIN_MM, MARGIN_MM) for stroke in strokes],
        [text.moved(MARGIN_MM, MARGIN_MM) for text in texts],
    )


def _marks(canvas: Any, plan: Plan, pages: Layout, tile: Tile, numbers: dict[tuple[int, int], int]) -> None:
    """Where the neighbours begin, and the crosses that lie on top of each other when the sheets are joined."""
    x_mm, y_mm = window_corner_mm()
    width_mm, height_mm = pages.window_mm
    crossed = crosses(plan) - (tile.x_mm, tile.y_mm)
    crossed = crossed[((crossed >= 0.0) & (crossed <= pages.window_mm)).all(axis=1)]
    edges = (
        _Edge(0, -1, (OVERLAP_MM, 0.0, OVERLAP_MM, height_mm), crossed[:, 0] <= OVERLAP_MM),
        _Edge(
            0, 1, (width_mm - OVERLAP_MM, 0.0, width_mm - OVERLAP_MM, height_mm), crossed[:, 0] >= width_mm - OVERLAP_MM
        ),
        _Edge(1, 0, (0.0, OVERLAP_MM, width_mm, OVERLAP_MM), crossed[:, 1] <= OVERLAP_MM),
        _Edge(
            -1,
            0,
            (0.0, height_mm - OVERLAP_MM, width_mm, height_mm - OVERLAP_MM),
            crossed[:, 1] >= height_mm - OVERLAP_MM,
        ),
    )
    strokes, texts = [], []
    for edge in edges:
        page = numbers.get((tile.row + edge.down, tile.column + edge.right))
        if page is None:
            continue
        line = np.array(edge.line).reshape(2, 2) + (x_mm, y_mm)
        plus = [arm + cross + (x_mm, y_mm) for cross in crossed[edge.shared] for arm in _PLUS]
        strokes += [Stroke("overlap", [line], MARK, 0.15, (2.0, 2.0)), Stroke("crosses", plus, MARK, 0.12)]
        x_middle_mm, y_middle_mm = (line.mean(axis=0) + 1.0).tolist()
        texts.append(
            Text(x_middle_mm, y_middle_mm, f"overlaps page {page}", MARK, 2.2, "end" if edge.right > 0 else "start")
        )
    _scaled(canvas, strokes, texts)


_PLUS = (np.array([[-1.0, 0.0], [1.0, 0.0]]), np.array([[0.0, -1.0], [0.0, 1.0]]))


@dataclass(frozen=True, slots=True)
class _Edge:
    """Towards the neighbour that many rows down and columns right: where it begins, which crosses it shows too."""

    down: int
    right: int
    line: tuple[float, float, float, float]
    shared: npt.NDArray[np.bool_]


def _scaled(canvas: Any, strokes: list[Stroke], texts: list[Text], pages: Layout | None = None) -> None:
    canvas.saveState()
    if pages is not None:
        clip = canvas.beginPath()
        sides = (*window_corner_mm(), *pages.window_mm)
        clip.rect(*(length * POINTS_PER_MM for length in sides))
        canvas.clipPath(clip, stroke=0, fill=0)
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    _paint(canvas, strokes, texts)
    canvas.restoreState()


def _paint(canvas: Any, strokes: list[Stroke], texts: list[Text]) -> None:
    """In millimetres."""
    canvas.setLineCap(1)
    canvas.setLineJoin(1)
    for stroke in strokes:
        path = canvas.beginPath()
        for line in stroke.lines:
            path.moveTo(*line[0].tolist())
            for point in line[1:].tolist():
                path.lineTo(*point)
            if stroke.filled:
                path.close()
        canvas.setStrokeColor(stroke.colour)
        canvas.setFillColor(stroke.colour)
        canvas.setLineWidth(stroke.width_mm)
        canvas.setDash(list(stroke.dash_mm) if stroke.dash_mm else [])
        canvas.drawPath(path, stroke=int(not stroke.filled), fill=int(stroke.filled))
    draw = {"start": canvas.drawString, "middle": canvas.drawCentredString, "end": canvas.drawRightString}
    for text in texts:
        canvas.setFillColor(text.colour)
        canvas.setFont(_FONT, text.height_mm)
        draw[text.anchor](text.x_mm, text.y_mm, text.text)
