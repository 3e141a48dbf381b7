"""Edges of doors in a preview frame: image, camera and wall in, columns of edges out.

The detector reads a band of the wall at the height of door handles, below every sign: there a wall has one colour, and
a stretch of another colour as wide as a door is a door. With calibrated colours (HSV boxes, from the specification) a
colour is a door's when a box holds it; without, when it differs from the tracked colour of the wall. Where the picture
reaches above boards and posters, an edge that goes on up there is a door's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from common.constants import CAMERA_HEIGHT_M
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Image
from onboard.poi.placement.wall_line import WallLine

Mask = npt.NDArray[np.bool_]
Colour = npt.NDArray[np.float64]  # (3,), blue green red

BAND_LOW_M, BAND_HEIGHT_M = 0.85, 0.14  # above the floor: below every sign
BAND_SHARE = 0.14  # of what the picture shows, at most
HIGH_BAND_LOW_M, HIGH_BAND_HEIGHT_M = 1.86, 0.08  # above what hangs on walls, below the lintel
BAND_ROWS = 12  # rows whose median is the colour of a column
DARKER, BRIGHTER = 0.78, 1.28  # luminance over the wall's
CHROMA_STEP = 0.022  # share of one colour in the sum of three
SOLID_M = 0.035  # an edge with less wall or door on one of its sides is noise
TRACKING = 0.3  # weight of the newest preview in the wall's colour
LOST_M = 1.6  # "door" over more than any door's width is the wall
BRIGHT_SHARE = 0.25  # of the columns: so many brighter ones are the wall


class Side(Enum):
    """Which edge of a door, as one looks at it."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True, slots=True)
class DoorEdge:
    """An edge between wall and door, in a column of the preview. `rises`: above what hangs on walls too, if known."""

    side: Side
    u_px: float
    rises: bool | None = None


@dataclass(frozen=True, slots=True)
class ColourBox:
    """Limits of hue (0 to 179), saturation and value (0 to 255), both ends included; a hue may wrap."""

    low: tuple[int, int, int]
    high: tuple[int, int, int]

    @classmethod
    def parse(cls, text: str) -> ColourBox:
        """From the form of robot.toml, `H8-22 S60-255 V30-230`; the configuration holds no other."""
        h0, h1, s0, s1, v0, v1 = map(int, re.findall(r"\d+", text))
        return cls((h0, s0, v0), (h1, s1, v1))

    def __str__(self) -> str:
        return " ".join(f"{name}{a}-{b}" for name, a, b in zip("HSV", self.low, self.high, strict=True))

    def holds(self, hsv: Image) -> Mask:
        """Which of the colours (..., 3) lie in the box."""
        value = hsv.astype(np.int16)
        low, high = np.array(self.low), np.array(self.high)
        inside = (value >= low) & (value <= high)
        if self.low[0] > self.high[0]:
            inside[..., 0] = (value[..., 0] >= low[0]) | (value[..., 0] <= high[0])
        return np.asarray(inside.all(axis=-1))


class DoorDetector:
    """Tracks the colour of the wall from frame to frame."""

    def __init__(self, boxes: tuple[ColourBox, ...] = ()) -> None:
        self._boxes = boxes
        self._wall: Colour | None = None
        self._lost_since_m: float | None = None

    def edges(self, preview: Image, camera: CameraModel, wall: WallLine, driven_m: float) -> list[DoorEdge]:
        """Edges between wall and door, from left to right; `driven_m` is the path driven so far (metres)."""
        colours = band_colours(preview, camera, wall)
        door = self._holds(colours) if self._boxes else self._stands_out(colours, driven_m)
        solid_px = SOLID_M / camera.metres_per_px(wall.distance_m)
        edges = door_edges(door, solid_px)
        if not edges or camera.height_m(0, wall.distance_m) < HIGH_BAND_LOW_M + HIGH_BAND_HEIGHT_M:
            return edges
        above = _colours_between(preview, camera, wall, HIGH_BAND_LOW_M, HIGH_BAND_HEIGHT_M)
        if self._boxes:
            high = self._holds(above)
        elif self._wall is not None:
            high = differs(above, self._wall)
        else:
            return edges
        return [replace(edge, rises=_rises(edge, high, solid_px)) for edge in edges]

    def _holds(self, colours: npt.NDArray[np.float64]) -> Mask:
        hsv = cv2.cvtColor(colours[None].astype(np.uint8), cv2.COLOR_BGR2HSV)[0]
        return np.asarray(np.any([box.holds(hsv) for box in self._boxes], axis=0))

    def _stands_out(self, colours: npt.NDArray[np.float64], driven_m: float) -> Mask:
        if self._wall is None:
            self._wall = np.median(colours, axis=0)
        out = differs(colours, self._wall)
        brighter = _luminance(colours) > BRIGHTER * _luminance(self._wall)
        if brighter.mean() > BRIGHT_SHARE:
            # Of two plain surfaces the brighter one is the wall: the tracked colour was a door's or a shadow's
            self._wall = np.median(colours[brighter], axis=0)
            out = differs(colours, self._wall)
        if out.mean() < 0.9:
            self._lost_since_m = None
            seen = np.median(colours[~out], axis=0)
            self._wall = (1 - TRACKING) * self._wall + TRACKING * seen
            return out
        if self._lost_since_m is None:
            self._lost_since_m = driven_m
        elif driven_m - self._lost_since_m > LOST_M:
            self._wall, self._lost_since_m = None, None
        return out

    def turned(self) -> None:
        """The camera sees another wall now, whose light may differ."""
        self._wall, self._lost_since_m = None, None


def band_colours(image: Image, camera: CameraModel, wall: WallLine) -> npt.NDArray[np.float64]:
    """Colour (width, 3) of the wall at the height of the band, column by column; as low as the picture shows."""
    depth_m = wall.distance_m
    lowest_m = max(BAND_LOW_M, CAMERA_HEIGHT_M - 0.98 * (CAMERA_HEIGHT_M - camera.height_m(camera.height_px, depth_m)))
    # From near by the picture ends little below the signs
    shown_m = camera.height_px * camera.metres_per_px(depth_m)
    return _colours_between(image, camera, wall, lowest_m, min(BAND_HEIGHT_M, BAND_SHARE * shown_m))


def _colours_between(
    image: Image, camera: CameraModel, wall: WallLine, low_m: float, height_m: float
) -> npt.NDArray[np.float64]:
    bottom, top = (camera.row_px(z_m, wall.distance_m) for z_m in (low_m, low_m + height_m))
    rows = np.linspace(bottom, top, BAND_ROWS).astype(int).clip(0, camera.height_px - 1)
    return np.asarray(np.median(image[rows], axis=0), dtype=np.float64)


def differs(colours: npt.NDArray[np.float64], wall: Colour) -> Mask:
    """Which colours (N, 3) differ from the wall's (3,) by more than light changes; (N,) of bool."""
    ratio = _luminance(colours) / max(float(_luminance(wall)), 1.0)
    chroma = np.abs(_chroma(colours) - _chroma(wall)).max(axis=-1)
    return np.asarray((ratio < DARKER) | (ratio > BRIGHTER) | (chroma > CHROMA_STEP))


def door_edges(door: Mask, solid_px: float) -> list[DoorEdge]:
    """Changes between wall and door in a mask (N,) that have `solid_px` columns of both on their sides."""
    changes = np.flatnonzero(np.diff(door.astype(np.int8))) + 1
    bounds = np.concatenate([[0], changes, [len(door)]])
    # Runs too narrow to be anything take the colour of what surrounds them
    clean = door.copy()
    for a, b in pairwise(bounds):
        if a > 0 and b < len(door) and b - a < solid_px:
            clean[a:b] = clean[a - 1]
    changes = np.flatnonzero(np.diff(clean.astype(np.int8))) + 1
    bounds = np.concatenate([[0], changes, [len(door)]])
    return [
        DoorEdge(Side.LEFT if clean[u] else Side.RIGHT, float(u))
        for before, u, after in zip(bounds[:-2], bounds[1:-1], bounds[2:], strict=True)
        if min(u - before, after - u) >= solid_px
    ]


def _rises(edge: DoorEdge, high: Mask, solid_px: float) -> bool:
    """Whether the door's side of an edge is door, and the wall's side wall, in the mask (N,) of the high band too."""
    u, reach = int(edge.u_px), max(1, int(solid_px))
    left, right = high[max(0, u - reach) : u].mean(), high[u : u + reach].mean()
    door, wall = (right, left) if edge.side is Side.LEFT else (left, right)
    return bool(door > 0.5 > wall)


def _luminance(colours: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(colours @ np.array([0.114, 0.587, 0.299]))


def _chroma(colours: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(colours / np.maximum(colours.sum(axis=-1, keepdims=True), 1.0))
