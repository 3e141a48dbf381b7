"""The reading part of the POI module alone, over photos from a folder: `indoor-mapping read-signs`.

A photo is read whole, without the distance that the robot would know. Where a file `<photo>.json` beside it gives pose
and distance of the wall, the sign gets a place too.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import radians
from pathlib import Path

import cv2

from common.config import PoiSection
from common.geometry import Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Image
from onboard.poi.camera.frame_source import pose_sidecar, read_photo
from onboard.poi.placement.wall_line import WallLine
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.photo_findings import PhotoFinding, explained
from onboard.poi.signs.photo_search import sign_readings
from onboard.poi.signs.sign_reading import SignReading, Verdict, sign_rules
from onboard.poi.signs.site_numbers import SiteNumbers, site_numbers

PHOTO_DETECTION_SIDE_PX = 640  # finds 98 % of the numbers in photos from 1 to 3 m, and no false ones


class PhotoReader:
    """Reads signs in photos of one site, one photo at a time. Loading its models takes about a second.

    `site`: which numbers count there, by all photos so far.
    """

    def __init__(self, section: PoiSection) -> None:
        self.site = site_numbers(section)
        self._section = section
        self._rules = sign_rules(section)
        self._reader = SignReader(PHOTO_DETECTION_SIDE_PX)
        self._numbers: list[RoomNumber] = []

    def findings(self, file: Path) -> list[PhotoFinding]:
        """All signs in a photo; raises StartError or OSError when photo or sidecar cannot be read."""
        photo = read_photo(file)
        readings = sign_readings(self._reader, self._rules, photo, PHOTO_DETECTION_SIDE_PX)
        self._numbers += [
            reading.number
            for reading in readings
            if reading.number is not None and reading.verdict in (Verdict.PLATE, Verdict.DOUBTFUL)
        ]
        self.site = self.site.after(self._numbers)
        return [PhotoFinding(str(file), reading, _place(file, photo, reading, self._section)) for reading in readings]


def _place(file: Path, photo: Image, reading: SignReading, section: PoiSection) -> dict[str, float]:
    sidecar = pose_sidecar(file)
    if not sidecar:
        return {}
    camera = CameraModel(photo.shape[1], photo.shape[0], radians(section.field_of_view_deg))
    bearing_rad = camera.bearing_rad(reading.box[0] + reading.box[2] / 2)
    pose = Pose2(sidecar["x_m"], sidecar["y_m"], sidecar["heading_rad"])
    point = WallLine(sidecar["wall_m"], 0.0).point(pose, bearing_rad)
    return {"x_m": round(point.x_m, 3), "y_m": round(point.y_m, 3)} if point is not None else {}


def write_explained(file: Path, findings: Sequence[PhotoFinding], site: SiteNumbers, to: Path) -> None:
    """The photo with the judgement of its signs drawn into it, as JPEG; raises StartError or OSError."""
    works, data = cv2.imencode(".jpg", explained(read_photo(file), findings, site))
    if not works:
        raise OSError(f"{to} cannot be encoded")
    to.write_bytes(data.tobytes())
