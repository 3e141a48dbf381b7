"""The colour of doors for robot.toml: a photo of a door and of the wall beside it in, an HSV box out. Pure.

The box is as wide as the wall allows: it must hold the door in other light, and must not hold the wall.
"""

from __future__ import annotations

from math import pi

import cv2
import numpy as np
import numpy.typing as npt

from onboard.poi.camera.frame import Image
from onboard.poi.doors.door_detection import ColourBox

MARGIN_SHARE = 0.1  # of a photo's width on each side, where the wall is
WALL_SHARE_MAX = 0.1  # of the wall that the box may hold: a skirting board, a switch, the door's frame
_SPREAD = (6, 30, 50)  # of hue, saturation and value, for other light
_WIDENINGS = (1.0, 0.6, 0.3)  # shares of it; with less, the next cloud would take the door out of the box
_HUES = 180
_GREY_SATURATION = 25  # below it a hue is noise

Colours = npt.NDArray[np.float64]  # (N, 3), HSV as OpenCV has it


def door_of(photo: Image) -> Image:
    """The middle of a photo, which a door fills."""
    rows, columns = photo.shape[0], photo.shape[1]
    return photo[rows // 4 : 3 * rows // 4, columns // 4 : 3 * columns // 4]


def wall_of(photo: Image) -> Image:
    """The left and right margins of a photo, next to each other."""
    margin = max(1, round(MARGIN_SHARE * photo.shape[1]))
    return np.concatenate([photo[:, :margin], photo[:, -margin:]], axis=1)


def calibrated_box(door: Image, wall: Image) -> tuple[ColourBox, float]:
    """The box, and the share of the wall that it holds.

    3rd to 97th percentile of the door's colours, widened as far as the wall allows. Above WALL_SHARE_MAX it serves for
    nothing: then no colours tell door from wall.
    """
    colours, wall_hsv = _hsv(door), cv2.cvtColor(wall, cv2.COLOR_BGR2HSV)
    for widening in _WIDENINGS:
        box = _box(colours, widening)
        share = float(box.holds(wall_hsv).mean())
        if share <= WALL_SHARE_MAX:
            break
    return box, share


def marked(photo: Image, box: ColourBox) -> bytes:
    """The photo as PNG, with everything darkened that the box does not hold."""
    inside = box.holds(cv2.cvtColor(photo, cv2.COLOR_BGR2HSV))
    _, data = cv2.imencode(".png", np.where(inside[..., None], photo, photo // 4))
    return data.tobytes()


def _hsv(image: Image) -> Colours:
    smooth = cv2.GaussianBlur(image, (0, 0), 2.0)
    return np.asarray(cv2.cvtColor(smooth, cv2.COLOR_BGR2HSV).reshape(-1, 3), dtype=np.float64)


def _box(colours: Colours, widening: float) -> ColourBox:
    # Hue is an angle: it is measured from its own mean direction
    mean_hue = np.angle(np.exp(1j * colours[:, 0] * 2 * pi / _HUES).mean()) * _HUES / (2 * pi)
    hsv = colours.copy()
    hsv[:, 0] = (hsv[:, 0] - mean_hue + _HUES / 2) % _HUES - _HUES / 2
    spread = widening * np.array(_SPREAD)
    low, high = np.percentile(hsv, 3, axis=0) - spread, np.percentile(hsv, 97, axis=0) + spread
    s0, v0 = np.maximum(low[1:], 0)
    s1, v1 = np.minimum(high[1:], 255)
    h0, h1 = (low[0] + mean_hue) % _HUES, (high[0] + mean_hue) % _HUES
    # Limits that meet on the other side of the circle would leave a sliver of what is every hue
    if high[0] - low[0] >= _HUES - 1 or np.median(hsv[:, 1]) < _GREY_SATURATION:
        h0, h1 = 0.0, _HUES - 1.0
    return ColourBox((int(h0), int(s0), int(v0)), (int(h1), int(s1), int(v1)))
