"""A robot drives along a drawn wall: what its camera shows in, the doors that the POI module makes of it out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians, sin
from random import Random

import cv2
import numpy as np
import numpy.typing as npt

from common.config import PoiSection
from common.constants import CAMERA_HEIGHT_M
from common.geometry import Pose2
from offboard.evaluate.doors.walls import HIGH_M, LENGTH_M, PX_PER_M, Look, ShownDoor, Wall, wall
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import PREVIEW_SIZE_PX, Image
from onboard.poi.doors.door_detection import DoorDetector
from onboard.poi.doors.door_records import DoorRecords
from onboard.poi.doors.door_view import look_for_doors
from onboard.poi.placement.wall_line import WallLine, WallPoint
from onboard.poi.signs.site_numbers import site_numbers

STEP_M = 0.064  # between previews at mapping speed
ROOM_BEHIND_M = 2.5  # of what is seen through a door
FOUND_M = 0.35  # between a door and its record
_END_M = 0.4
_NOISE_MARGIN = 64  # a frame takes a random part of one field of noise
_NOISE_SHAPE = (PREVIEW_SIZE_PX[1] + _NOISE_MARGIN, PREVIEW_SIZE_PX[0] + _NOISE_MARGIN, 3)
_CAMERA = CameraModel(*PREVIEW_SIZE_PX)


@dataclass(frozen=True, slots=True)
class Passed:
    """What a drive along one wall made of its doors: found, missed, and places of records that are no doors."""

    look: Look
    found: tuple[ShownDoor, ...]
    missed: tuple[ShownDoor, ...]
    false_m: tuple[float, ...]
    others: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class View:
    """Where the camera is: along the wall, from the wall, turned from square, rolled; and the light."""

    x_m: float
    distance_m: float
    skew_rad: float
    roll_rad: float
    gain: float


def passed(look: Look, index: int, seed: int = 1) -> Passed:
    """Drives along a wall in the direction in which it is on the robot's right."""
    drawn = wall(look, index, seed)
    rng = Random(f"{seed} drive {look.value} {index}")
    noise = np.random.default_rng(rng.getrandbits(32)).normal(0.0, rng.uniform(1.5, 4.0), _NOISE_SHAPE)
    records = DoorRecords(lambda left, right: _backed(drawn, left, right), site_numbers(PoiSection()))
    detector = DoorDetector()
    distance_m, roll_rad, phase = rng.uniform(1.05, 1.9), radians(rng.gauss(0, 0.4)), rng.uniform(0, 2 * pi)
    # A lens sees the mean of what a pixel covers; the warp below would skip it
    sigma_px = 0.4 * PX_PER_M * distance_m / _CAMERA.focal_px
    drawn = replace(drawn, front=np.asarray(cv2.GaussianBlur(drawn.front, (0, 0), sigma_px), np.uint8))
    count = int((LENGTH_M - 2 * _END_M) / STEP_M)
    for i in range(count):
        swing = sin(phase + 0.15 * i)
        view = View(LENGTH_M - _END_M - i * STEP_M, distance_m, radians(2.0) * swing, roll_rad, 0.9 + 0.08 * swing)
        at = rng.randrange(_NOISE_MARGIN), rng.randrange(_NOISE_MARGIN)
        image = photographed(drawn, view, noise[at[0] :, at[1] :])
        # The robot's right is the wall; what is right on the wall lies behind it
        pose = Pose2(-view.x_m, distance_m, view.skew_rad)
        line = WallLine(distance_m + rng.gauss(0, 0.01), -view.skew_rad + rng.gauss(0, radians(0.5)))
        look_for_doors(image, _CAMERA, pose, line, detector, records, i * STEP_M, 0.4 * i)
    return _compared(drawn, [-door.centre.x_m for door in records.doors()])


def _compared(drawn: Wall, records_m: list[float]) -> Passed:
    left, found, missed = list(records_m), [], []
    for door in drawn.doors:
        nearest = min(left, key=lambda at: abs(at - door.centre_m), default=None)
        if nearest is not None and abs(nearest - door.centre_m) < FOUND_M:
            left.remove(nearest)
            found.append(door)
        else:
            missed.append(door)
    return Passed(drawn.look, tuple(found), tuple(missed), tuple(left), drawn.others)


def _backed(drawn: Wall, left: WallPoint, right: WallPoint) -> bool:
    a, b = -left.x_m, -right.x_m
    samples = np.linspace(a + 0.15 * (b - a), b - 0.15 * (b - a), 5)
    on_wall = [not any(low + 0.1 < x < high - 0.1 for low, high in drawn.gaps) for x in samples]
    return sum(on_wall) >= 4


def photographed(drawn: Wall, view: View, noise: npt.NDArray[np.float64]) -> Image:
    """The preview from a view, with a part of `noise` that is large enough."""
    front = _projected(drawn.front, view, 0.0)
    share = _projected(drawn.open_share, view, 0.0)
    if share.any():
        through = share[..., None].astype(np.float32) / 255.0
        front = front + through * (_projected(drawn.behind, view, ROOM_BEHIND_M) - front.astype(np.float32))
    front = cv2.convertScaleAbs(cv2.GaussianBlur(front, (0, 0), 0.7), alpha=view.gain)
    return np.asarray(cv2.add(front, noise[: front.shape[0], : front.shape[1]], dtype=cv2.CV_8U), np.uint8)


def _projected(plane: Image, view: View, behind_m: float) -> Image:
    """A plane parallel to the wall, as a picture."""
    corners_m = [(view.x_m + dx, z) for dx, z in ((-1.5, 0.8), (1.5, 0.8), (1.5, 2.2), (-1.5, 2.2))]
    seen = []
    for x_m, z_m in corners_m:
        aside, ahead = x_m - view.x_m, view.distance_m + behind_m
        # Turned to the left by the skew, the camera sees the wall further right
        c, s = np.cos(view.skew_rad), np.sin(view.skew_rad)
        u, depth = aside * c + ahead * s, ahead * c - aside * s
        column, row = _CAMERA.focal_px * u / depth, -_CAMERA.focal_px * (z_m - CAMERA_HEIGHT_M) / depth
        cr, sr = np.cos(view.roll_rad), np.sin(view.roll_rad)
        seen.append((_CAMERA.width_px / 2 + cr * column - sr * row, _CAMERA.height_px / 2 + sr * column + cr * row))
    source = np.array([(PX_PER_M * x, PX_PER_M * (HIGH_M - z)) for x, z in corners_m], np.float32)
    matrix = cv2.getPerspectiveTransform(source, np.array(seen, np.float32))
    return np.asarray(cv2.warpPerspective(plane, matrix, PREVIEW_SIZE_PX, borderMode=cv2.BORDER_REPLICATE), np.uint8)
