"""One look at the wall: a preview with its pose in, what it shows of doors into the records."""

from __future__ import annotations

import cv2
import numpy as np

from common.geometry import Pose2
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Image
from onboard.poi.doors.door_detection import DoorDetector
from onboard.poi.doors.door_records import DoorRecords
from onboard.poi.doors.handles import handle_columns
from onboard.poi.doors.jamb_lines import jamb_views
from onboard.poi.placement.wall_line import WallLine


def look_for_doors(
    preview: Image,
    camera: CameraModel,
    pose: Pose2,
    wall: WallLine,
    detector: DoorDetector,
    records: DoorRecords,
    driven_m: float,
    now_s: float,
) -> None:
    """Edges by colour, jambs by lines, and handles; `driven_m` is the path driven so far."""
    for edge in detector.edges(preview, camera, wall, driven_m):
        point = wall.point(pose, camera.bearing_rad(edge.u_px))
        if point is not None:
            records.add_edge(edge.side, point, now_s, edge.rises)
    gray = np.asarray(cv2.cvtColor(preview, cv2.COLOR_BGR2GRAY), np.uint8)
    for jamb in jamb_views(gray, camera, wall.distance_m):
        point = wall.point(pose, camera.bearing_rad(jamb.u_px))
        if point is not None:
            records.add_jamb(jamb, point, now_s)
    for u_px in handle_columns(gray, camera, wall.distance_m):
        point = wall.point(pose, camera.bearing_rad(u_px))
        if point is not None:
            records.add_handle(point, now_s)
