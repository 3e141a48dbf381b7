"""How a plan of 1:100 is laid out on pages of A4 or A3, which overlap. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from offboard.export.plan import MM_PER_M, Plan
from offboard.export.sheet import BLOCK_MM, MARGIN_MM
from offboard.export.title import PAPERS_MM

OVERLAP_MM = 10.0
_GAP_MM = 2.0  # between window and title block
_EMPTY = ("grid",)  # what is on every page, also where the plan has nothing
OVERVIEW_SCALES = (200, 250, 400, 500, 750, 1000, 1500, 2000, 2500, 5000, 10_000)


@dataclass(frozen=True, slots=True)
class Tile:
    """A part of the plan: the window's lower left corner in the plan, its row from the top and column, from 0."""

    row: int
    column: int
    x_mm: float
    y_mm: float

    @property
    def name(self) -> str:
        """As on a chess board, rows from the top: A1, A2, B1."""
        return f"{_letters(self.row)}{self.column + 1}"


@dataclass(frozen=True, slots=True)
class Layout:
    """Pages of one size, and the windows that they show; empty ones are left out."""

    page_width_mm: float
    page_height_mm: float
    tiles: list[Tile]

    @property
    def window_mm(self) -> tuple[float, float]:
        """Width and height of what a page shows of the plan, above its title block."""
        return _window_mm(self.page_width_mm, self.page_height_mm)

    def overview_scale(self, plan: Plan) -> int:
        """1 : this brings the whole plan onto one page."""
        width_mm, height_mm = self.window_mm
        needed = 100 * max(plan.width_mm / width_mm, plan.height_mm / height_mm)
        return next((scale for scale in OVERVIEW_SCALES if scale >= needed), ceil(needed))


def layout(plan: Plan, paper: str) -> Layout:
    """Upright or across, whichever takes fewer pages."""
    short_mm, long_mm = PAPERS_MM[paper]
    layouts = [Layout(*page, _tiles(plan, *_window_mm(*page))) for page in ((short_mm, long_mm), (long_mm, short_mm))]
    return min(layouts, key=lambda one: len(one.tiles))


def _window_mm(page_width_mm: float, page_height_mm: float) -> tuple[float, float]:
    return page_width_mm - 2 * MARGIN_MM, page_height_mm - 2 * MARGIN_MM - BLOCK_MM - _GAP_MM


def window_corner_mm() -> tuple[float, float]:
    """Where the window begins on a page, from its lower left corner."""
    return MARGIN_MM, MARGIN_MM + BLOCK_MM + _GAP_MM


def _tiles(plan: Plan, width_mm: float, height_mm: float) -> list[Tile]:
    """In reading order."""
    columns, rows = _count(plan.width_mm, width_mm), _count(plan.height_mm, height_mm)
    x_step_mm, y_step_mm = width_mm - OVERLAP_MM, height_mm - OVERLAP_MM
    top_mm = plan.height_mm - height_mm if rows > 1 else 0.0
    tiles = [
        Tile(row, column, column * x_step_mm, top_mm - row * y_step_mm)
        for row in range(rows)
        for column in range(columns)
    ]
    there = _segments(plan)
    return [tile for tile in tiles if _shows_some(tile, width_mm, height_mm, there)] or tiles[:1]


def _count(length_mm: float, window_mm: float) -> int:
    return max(1, ceil((length_mm - OVERLAP_MM) / (window_mm - OVERLAP_MM)))


def _segments(plan: Plan) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(N, 4) smallest and largest x and y of every straight part of the plan, its letters as points."""
    boxes = [
        (min(ax, bx), min(ay, by), max(ax, bx), max(ay, by))
        for stroke in plan.strokes
        if stroke.name not in _EMPTY
        for line in stroke.lines
        for (ax, ay), (bx, by) in pairwise(line.tolist())
    ]
    boxes += [(text.x_mm, text.y_mm, text.x_mm, text.y_mm) for text in plan.texts]
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)


def _shows_some(
    tile: Tile, width_mm: float, height_mm: float, boxes: np.ndarray[tuple[int, int], np.dtype[np.float64]]
) -> bool:
    right_of, above = boxes[:, 2] >= tile.x_mm, boxes[:, 3] >= tile.y_mm
    left_of, below = boxes[:, 0] <= tile.x_mm + width_mm, boxes[:, 1] <= tile.y_mm + height_mm
    return bool((right_of & above & left_of & below).any())


def _letters(number: int) -> str:
    """A to Z, then AA, AB ..."""
    letters = chr(ord("A") + number % 26)
    return letters if number < 26 else _letters(number // 26 - 1) + letters


def crosses(plan: Plan, step_m: float = 1.0) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(N, 2) whole metres of the map, in the plan: where sheets that overlap show the same mark."""
    step_mm = step_m * MM_PER_M
    xs, ys = np.arange(0.0, plan.width_mm + 1e-6, step_mm), np.arange(0.0, plan.height_mm + 1e-6, step_mm)
    return np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
