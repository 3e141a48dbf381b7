"""A small picture of a recorded run for the list of runs: wall points, path, doors -> PNG on a clear ground. Pure."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageDraw

from common.geometry import Points
from offboard.runs.run_folder import MapData

SIZE = 480, 300
_MARGIN_PX = 24
_LEAST_M = 4.0  # a run that hardly moved is not blown up
# Colours that are seen on light and on dark ground
_WALL, _INFERRED, _PATH, _DOOR = "#6b7b8c", "#a3afbb", "#4a8fd8", "#e03a42"
_OVERSAMPLING = 2
_DASH_M = 0.4


def thumbnail(data: MapData) -> bytes:
    """PNG of SIZE; empty ground for a run without anything drawn."""
    doors_m = np.array([(poi["x_m"], poi["y_m"]) for poi in data.pois], np.float64).reshape(-1, 2)
    path_m = data.trajectory[:, :2]
    everything = np.concatenate([data.points_m, path_m, doors_m])
    width, height = (side * _OVERSAMPLING for side in SIZE)
    image = Image.new("RGBA", (width, height), (0, 0, 0, 0))
    if len(everything):
        low, high = everything.min(axis=0), everything.max(axis=0)
        margin = _MARGIN_PX * _OVERSAMPLING
        scale = min((np.array([width, height]) - 2 * margin) / np.maximum(high - low, _LEAST_M))
        middle = (low + high) / 2

        def place(points_m: Points) -> list[tuple[float, float]]:
            shown = (points_m - middle) * (scale, -scale) + (width / 2, height / 2)
            return [(x, y) for x, y in shown.tolist()]

        brush = ImageDraw.Draw(image)
        if len(path_m) > 1:
            brush.line(place(path_m), fill=_PATH, width=_OVERSAMPLING)
        inferred = data.inferred != 0
        gap = np.floor((data.points_m @ (1.0, 0.8)) / _DASH_M) % 2 == 0  # along nearly every wall every other one
        for shown, colour in ((inferred & ~gap, _INFERRED), (~inferred, _WALL)):
            _dots(brush, place(data.points_m[shown]), 1.1 * _OVERSAMPLING, colour)
        _dots(brush, place(doors_m), 2.6 * _OVERSAMPLING, _DOOR)
    out = io.BytesIO()
    image.resize(SIZE, Image.Resampling.LANCZOS).save(out, "PNG")
    return out.getvalue()


def _dots(brush: ImageDraw.ImageDraw, places: list[tuple[float, float]], radius: float, colour: str) -> None:
    for x, y in places:
        brush.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)
