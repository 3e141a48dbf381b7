"""Free space -> halls and other spaces with their areas: occupancy image, walls and path -> `Space`s.

All is turned so that walls lie along rows and columns of cells. A cell belongs to a hall along the rows where the free
run through it is longer along its row than along its column, and the other way round; what hangs together is a hall.
So a junction belongs to the longer of the halls that meet there, and each cell to one hall only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, sin
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from common.geometry import Points, RightAngles
from offboard.export.occupancy_image import CELL_M, FREE, OccupancyImage, image_of_run
from offboard.export.wall_lines import simplify, wall_lines
from offboard.runs.run_folder import read_map, read_path

Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]

NARROW_M = 0.5  # the robot fits through nothing narrower
SMALLEST_M2 = 3.0  # smaller than this is an alcove of the space beside it
HALL_LENGTH_TO_WIDTH = 1.5  # what is less elongated is an area, such as a lobby
SHADOW_M = 0.35  # beams that graze a wall end so far before it: what lies between is free
DIRECTION_MIN_M = 0.5  # shorter walls have no direction


@dataclass(frozen=True, slots=True)
class Space:
    """`outline` (N, 2) in the map, counter-clockwise, first point not repeated."""

    number: int  # from 1, largest first
    kind: str  # "hall" or "area"
    outline: Points
    area_m2: float
    length_m: float
    width_m: float

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Of a place from the outline, 0 inside."""
        at, a, b = np.array([x_m, y_m]), self.outline, np.roll(self.outline, -1, axis=0)
        crossed = (a[:, 1] > y_m) != (b[:, 1] > y_m)
        rise_m = np.where(crossed, b[:, 1] - a[:, 1], 1.0)
        right_of = a[:, 0] + (y_m - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise_m > x_m
        if np.count_nonzero(crossed & right_of) % 2:
            return 0.0
        share = np.clip(((at - a) * (b - a)).sum(axis=1) / np.maximum(((b - a) ** 2).sum(axis=1), 1e-12), 0.0, 1.0)
        return float(np.hypot(*(at - a - share[:, None] * (b - a)).T).min())


def spaces_of_run(run_dir: Path) -> list[Space]:
    data = read_map(run_dir)
    _, poses = read_path(run_dir)
    return find_spaces(image_of_run(run_dir), wall_lines(data.points_m), poses[:, :2])


def find_spaces(image: OccupancyImage, walls_m: list[Points], path_m: Points) -> list[Space]:
    """Largest first; `walls_m` are polylines, `path_m` (N, 2) is where the robot drove."""
    frame = _Frame.of(image, _main_direction_rad(walls_m))
    wall = frame.marked(np.concatenate([np.empty((0, 2)), *map(_dense, walls_m)]))
    free = _up_to_walls(frame.sampled(image.cells[::-1] == FREE, image), wall)
    free = _reached(free & ~wall, frame.marked(path_m))
    free &= np.minimum(_run_lengths(free), _run_lengths(free.T).T) * CELL_M >= NARROW_M
    along_rows = _run_lengths(free) >= _run_lengths(free.T).T
    labels = _without_small(*_parts(free & along_rows, free & ~along_rows))
    boxes = [(label, box) for label, box in enumerate(ndimage.find_objects(labels), 1) if box is not None]
    spaces = [_space(labels == label, wall, box, frame) for label, box in boxes]
    spaces = sorted((s for s in spaces if s.area_m2 >= SMALLEST_M2), key=lambda space: -space.area_m2)
    return [replace(space, number=k) for k, space in enumerate(spaces, 1)]


def _main_direction_rad(lines_m: list[Points]) -> float:
    """That of most of the walls' length, in (-pi/4, pi/4]."""
    angles = RightAngles()
    for line in lines_m:
        for x_m, y_m in np.diff(line, axis=0).tolist():
            length_m = float(np.hypot(x_m, y_m))
            if length_m >= DIRECTION_MIN_M:
                angles = angles.with_direction(float(np.arctan2(y_m, x_m)), length_m)
    return angles.direction_rad


def _dense(line: Points) -> Points:
    """Points on a polyline, nearer to each other than a cell is wide."""
    parts = [
        a + np.linspace(0.0, 1.0, int(np.hypot(*(b - a)) / CELL_M * 2) + 2)[:, None] * (b - a)
        for a, b in pairwise(line)
    ]
    return np.concatenate(parts)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Cells turned to the walls' direction: (x, y) of the outer corner of cell (0, 0), direction of its rows, shape."""

    origin_m: Points
    direction_rad: float
    rows: int
    columns: int

    @classmethod
    def of(cls, image: OccupancyImage, direction_rad: float) -> _Frame:
        rows, columns = image.cells.shape
        corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)]) * CELL_M
        turn = _turn(direction_rad)
        turned = (corners + (image.origin_x_m, image.origin_y_m)) @ turn.T
        low = turned.min(axis=0)
        size = np.ceil((turned.max(axis=0) - low) / CELL_M).astype(int)
        return cls(low @ turn, direction_rad, int(size[1]), int(size[0]))

    def to_map(self, corners: Points) -> Points:
        """Corners of cells (N, 2), as column and row."""
        return np.asarray(corners * CELL_M @ _turn(self.direction_rad) + self.origin_m)

    def marked(self, points_m: Points) -> Mask:
        """The cells that hold one of the points (N, 2)."""
        cells = np.zeros((self.rows, self.columns), dtype=bool)
        column, row = np.floor((points_m - self.origin_m) @ _turn(self.direction_rad).T / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        cells[row[inside], column[inside]] = True
        return cells

    def sampled(self, cells: Mask, image: OccupancyImage) -> Mask:
        """Cells of the image, row 0 at its lowest y, in this frame: each as the one that its middle lies in."""
        middles = np.stack(np.meshgrid(np.arange(self.columns) + 0.5, np.arange(self.rows) + 0.5), axis=-1)
        places_m = self.to_map(middles.reshape(-1, 2)) - (image.origin_x_m, image.origin_y_m)
        column, row = np.floor(places_m / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (column < cells.shape[1]) & (row >= 0) & (row < cells.shape[0])
        sampled = np.zeros(self.rows * self.columns, dtype=bool)
        sampled[inside] = cells[row[inside], column[inside]]
        return sampled.reshape(self.rows, self.columns)


def _turn(direction_rad: float) -> Points:
    """(2, 2): `points @ it` turns by the direction, `points @ it.T` back."""
    c, s = cos(direction_rad), sin(direction_rad)
    return np.array([[c, s], [-s, c]])


def _up_to_walls(free: Mask, wall: Mask) -> Mask:
    """Free cells, and those between them and a wall that is not farther than SHADOW_M along a row or column."""
    reach = round(SHADOW_M / CELL_M)
    filled = free.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        source = free & ~wall
        fronts = [source]
        for _ in range(reach):
            fronts.append(_shifted(fronts[-1], axis, step) & ~wall)
        # Backwards: a front that meets a wall in its next cell keeps what it came through
        kept = np.zeros_like(free)
        for front in reversed(fronts):
            kept = front & (_shifted(kept | wall, axis, -step))
            filled |= kept
    return filled


def _shifted(cells: Mask, axis: int, step: int) -> Mask:
    shifted = np.roll(cells, step, axis)
    edge = [slice(None), slice(None)]
    edge[axis] = slice(0, 1) if step > 0 else slice(-1, None)
    shifted[tuple(edge)] = False
    return shifted


def _reached(free: Mask, driven: Mask) -> Mask:
    """What hangs together with where the robot drove."""
    labels, _ = ndimage.label(free)
    return np.asarray(np.isin(labels, np.unique(labels[driven & free])) & free)


def _run_lengths(mask: Mask) -> Labels:
    """Of each set cell, how many set cells its row has around it without a gap; 0 elsewhere."""
    rows, columns = mask.shape
    padded = np.zeros((rows, columns + 2), np.int8)
    padded[:, 1:-1] = mask
    change = np.diff(padded, axis=1)
    begins, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    steps = np.zeros(change.size, np.int32)
    steps[begins] += (ends - begins).astype(np.int32)
    steps[ends] -= (ends - begins).astype(np.int32)
    return np.asarray(np.cumsum(steps.reshape(change.shape), axis=1)[:, :-1], dtype=np.int32)


def _parts(*masks: Mask) -> tuple[Labels, int]:
    """One number for each part of each mask that hangs together, from 1."""
    labels, count = np.zeros(masks[0].shape, np.int32), 0
    for mask in masks:
        own, more = ndimage.label(mask)
        labels[mask] = own[mask] + count
        count += more
    return labels, count


def _without_small(labels: Labels, count: int) -> Labels:
    """Parts smaller than SMALLEST_M2 join the neighbour that they have most of their border with, smallest first."""
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    borders: list[dict[int, int]] = [{} for _ in range(count + 1)]
    for a, b in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        touching = (a != b) & (a > 0) & (b > 0)
        pairs, lengths = np.unique(np.sort([a[touching], b[touching]], axis=0), axis=1, return_counts=True)
        for first, second, length in zip(*pairs.tolist(), lengths.tolist(), strict=True):
            borders[first][second] = borders[first].get(second, 0) + length
            borders[second][first] = borders[second].get(first, 0) + length
    owner = np.arange(count + 1, dtype=np.int32)
    for part in (np.argsort(sizes[1:], kind="stable") + 1).tolist():
        if sizes[part] * CELL_M**2 >= SMALLEST_M2 or not borders[part]:
            continue
        into = max(borders[part], key=borders[part].__getitem__)
        owner[owner == part] = into
        sizes[into] += sizes[part]
        for other, length in borders[part].items():
            del borders[other][part]
            if other != into:
                borders[into][other] = borders[other][into] = borders[into].get(other, 0) + length
        borders[part] = {}
    return owner[labels]


def _space(part: Mask, wall: Mask, box: tuple[slice, ...], frame: _Frame) -> Space:
    """From one end to the other, between the lowest and highest cell of every column, or row where that is longer."""
    lies = part[box].shape[1] >= part[box].shape[0]
    part, wall = (part, wall) if lies else (part.T, wall.T)
    stations = np.flatnonzero(part.any(axis=0))
    low = part.argmax(axis=0)[stations]
    high = part.shape[0] - part[::-1].argmax(axis=0)[stations]
    # The face of a wall is in the middle of its cell
    lower = low - 0.5 * wall[np.maximum(low - 1, 0), stations]
    upper = high + 0.5 * wall[np.minimum(high, part.shape[0] - 1), stations]
    outline = np.concatenate([simplify(_stairs(stations, lower), 0.4), simplify(_stairs(stations, upper), 0.4)[::-1]])
    if not lies:
        outline = outline[::-1, ::-1]
    outline = frame.to_map(outline)
    area_m2, length_m = _area_m2(outline), len(stations) * CELL_M
    width_m = area_m2 / length_m
    kind = "hall" if length_m >= HALL_LENGTH_TO_WIDTH * width_m else "area"
    return Space(0, kind, outline, area_m2, length_m, width_m)


def _stairs(stations: npt.NDArray[np.int64], ends: npt.NDArray[np.float64]) -> Points:
    """The outer edge of cells: two corners for each station."""
    return np.column_stack([np.stack([stations, stations + 1], axis=1).ravel(), np.repeat(ends, 2)]).astype(np.float64)


def _area_m2(outline: Points) -> float:
    x, y = outline.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
