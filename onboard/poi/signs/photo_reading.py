"""The reading part of the POI module alone, over photos from a folder: `indoor-mapping read-signs`.

A photo is read whole, without the distance that the robot would know. Where a file `<photo>.json` beside it gives pose
and distance of the wall, the sign gets a place too.
"""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Any

import cv2

from common.config import PoiSection
from common.geometry import Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import FULL_SIZE_PX, Image
from onboard.poi.camera.frame_source import pose_sidecar, read_photo
from onboard.poi.camera.sharpness import sharpness
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.grouping import signs
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.sign_reading import SignReading, Verdict, sign_rules

PHOTO_DETECTION_SIDE_PX = 640  # finds 98 % of the numbers in photos from 1 to 3 m, and no false ones


class PhotoReader:
    """Reads number plates in photos, one photo at a time. Loading its models takes about a second."""

    def __init__(self, section: PoiSection) -> None:
        self._section = section
        self._rules = sign_rules(section)
        self._reader = SignReader(PHOTO_DETECTION_SIDE_PX)

    def findings(self, file: Path) -> list[dict[str, Any]]:
        """One record per number plate; raises StartError or OSError when photo or sidecar cannot be read."""
        photo = read_photo(file)
        scale = min(1.0, FULL_SIZE_PX[0] / max(photo.shape[:2]))
        image = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else photo
        readings = (self._rules.judge(lines) for lines in signs(self._reader.lines(image)))
        return [
            _record(file, image, reading, scale) | _place(file, photo, reading, scale, self._section)
            for reading in readings
            if reading.verdict is Verdict.PLATE
        ]


def _record(file: Path, image: Image, reading: SignReading, scale: float) -> dict[str, Any]:
    x, y, width, height = reading.box
    part = image[max(int(y), 0) : int(y + height) + 1, max(int(x), 0) : int(x + width) + 1]
    sharp = sharpness(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY))
    return {
        "file": str(file),
        "number": reading.number.shown if reading.number is not None else "",
        "room_type": reading.room_type,
        "confidence": round(reading.confidence, 4),
        "box_px": [round(v / scale, 1) for v in reading.box],
        "sharpness": round(sharp.gradient, 1),
        "laplacian_variance": round(sharp.laplacian_variance, 1),
        "high_frequency_share": round(sharp.high_frequency_share, 4),
    }


def _place(file: Path, photo: Image, reading: SignReading, scale: float, section: PoiSection) -> dict[str, float]:
    sidecar = pose_sidecar(file)
    if not sidecar:
        return {}
    camera = CameraModel(photo.shape[1], photo.shape[0], radians(section.field_of_view_deg))
    bearing_rad = camera.bearing_rad((reading.box[0] + reading.box[2] / 2) / scale)
    pose = Pose2(sidecar["x_m"], sidecar["y_m"], sidecar["heading_rad"])
    point = WallLine(sidecar["wall_m"], 0.0).point(pose, bearing_rad)
    return {"x_m": round(point.x_m, 3), "y_m": round(point.y_m, 3)} if point is not None else {}
