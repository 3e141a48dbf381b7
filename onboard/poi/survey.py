"""The perception of the POI module: poses, echoes and frames in, observations of doors and signs into the records.

The cheap preview decides: where a door begins or ends, and whether something that may be a sign stands whole in the
picture and is not settled yet. Only then it requests a full frame, at most one per FULL_SPACING_M (less near to a
wall), and sends the part around the candidate to the worker. Frames of a turning robot are skipped: they are blurred,
and have no wall line.
"""

from __future__ import annotations

import logging
from math import atan2, hypot, inf

import cv2

from common.bus import Bus
from common.constants import SONAR_RIGHT
from common.geometry import Pose2, wrap_angle
from common.messages.mapping import PoseEstimate
from common.messages.motion import Ranges
from common.messages.topics import MAP, POSE, RANGES, TRAJECTORY
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import FULL_SIZE_PX, PREVIEW_SIZE_PX, Frame, Image
from onboard.poi.camera.frame_health import FrameHealth
from onboard.poi.camera.frame_source import FrameSource
from onboard.poi.doors.door_detection import ColourBox, DoorDetector
from onboard.poi.doors.door_records import DoorRecords
from onboard.poi.doors.door_view import look_for_doors
from onboard.poi.placement.imaged_wall import ImagedWall
from onboard.poi.placement.map_shift import BelievedPath, MapShift
from onboard.poi.placement.pose_history import PoseHistory
from onboard.poi.placement.wall_line import WallLine, WallPoint, WallTracker
from onboard.poi.placement.wall_map import WallMap
from onboard.poi.signs.reading_job import Finding, Job, Reading, ReadingWorker
from onboard.poi.signs.sign_detection import Box, sign_candidates
from onboard.poi.signs.site_numbers import SiteNumbers

TURNING_RAD_S = 0.08  # above it previews blur and the sonar measures other walls
FULL_SPACING_M, FULL_SPACING_RAD = 0.12, 0.1  # path between two full frames, and over the distance of the wall
STANDING_SPACING_S = 0.4  # between two full frames of a robot that holds: one per preview
FRAME_AGE_MAX_S = 1.0  # an older preview is dropped
POSE_WAIT_S = 0.25  # how long a frame waits for the pose after it
JOBS_MAX = 4  # that wait or run; further ones are dropped
JOBS_AT_ONCE = 3  # below JOBS_MAX, since a frame may hold several signs
SKEW_MAX_RAD = 0.2  # between the wall line of the echoes and the wall on the map
PHOTO_QUALITY = 80  # of the JPEG, 0 to 100


_log = logging.getLogger("poi")


class Survey:
    """Owns source and worker. `photos_read` counts the full frames that were read; `wall_m` is the distance of the wall
    that was looked at last."""

    def __init__(
        self,
        source: FrameSource,
        worker: ReadingWorker,
        boxes: tuple[ColourBox, ...],
        field_of_view_rad: float,
        site: SiteNumbers,
    ) -> None:
        self.map = WallMap()
        self.records = DoorRecords(self.map.backs, site)
        self.imaged = ImagedWall()
        self.history = PoseHistory()
        self.photos_read = 0
        self.wall_m = 1.0
        self.health = FrameHealth()
        self.engine_missing = False
        self.worker = worker
        self._source = source
        self._full_camera = CameraModel(*FULL_SIZE_PX, field_of_view_rad)
        self._preview_camera = self._full_camera.resized(*PREVIEW_SIZE_PX)
        self._walls = WallTracker()
        self._path = BelievedPath()
        self._doors = DoorDetector(boxes)
        self._held: Frame | None = None  # a preview that waits for its pose
        self._full: Frame | None = None
        self._driven_m = 0.0
        self._last: Pose2 | None = None
        self._full_at_m, self._full_at_s = -inf, -inf

    def receive(self, bus: Bus, now_s: float) -> list[MapShift]:
        """Takes poses, echoes and the map from the bus; returns how the map has moved, as all observations have."""
        for update in bus.take(MAP):
            self.map.add(update)
        arrived_s = now_s - bus.age_s(POSE)
        for estimate in bus.take(POSE):
            if estimate.valid:
                self._add_pose(estimate, arrived_s)
        for ranges in bus.take(RANGES):
            self._add_echo(ranges)
        shifts = [self._path.update(trajectory, self.history) for trajectory in bus.take(TRAJECTORY)]
        for shift in shifts:
            self.records.move(shift)
            self.imaged.move(shift)
        return shifts

    def look(self, now_s: float, holding: bool) -> None:
        """Handles what source and worker have; `holding`: the robot stands and takes photos of what is in view."""
        preview = self._source.preview(now_s)
        if preview is not None and self.health.takes(preview.image, now_s, self._driven_m):
            self._held = preview
        full = self._source.full(now_s)
        if full is not None:
            self._full = full
        if self._held is not None and self._posed(self._held, now_s):
            frame, self._held = self._held, None
            self._look_at_preview(frame, now_s, holding)
        if self._full is not None and self._posed(self._full, now_s):
            frame, self._full = self._full, None
            self._send_to_reader(frame, now_s)
        while (outcome := self.worker.result(now_s)) is not None:
            assert outcome.value is not None
            self._record(outcome.value, now_s)

    def close(self) -> None:
        self._source.close()
        self.worker.close()

    @property
    def turning(self) -> bool:
        return self.history.motion()[1] > TURNING_RAD_S

    def _add_pose(self, estimate: PoseEstimate, arrived_s: float) -> None:
        self.history.add(estimate, arrived_s)
        pose = self.history.newest
        if pose is not None and self._last is not None:
            self._driven_m += hypot(pose.x_m - self._last.x_m, pose.y_m - self._last.y_m)
        self._last = pose

    def _add_echo(self, ranges: Ranges) -> None:
        if not ranges.valid or self.turning:
            return
        pose = self.history.at_stamp(ranges.t_s - ranges.age_s[SONAR_RIGHT])
        if pose is not None:
            self._walls.add(pose, ranges.range_m[SONAR_RIGHT])

    def _posed(self, frame: Frame, now_s: float) -> bool:
        """The pose of its moment is known, or the frame has waited long enough for it."""
        return self.history.covers(frame.t_s) or now_s - frame.t_s > POSE_WAIT_S

    def _beside(self, frame: Frame) -> tuple[Pose2, WallLine] | None:
        pose = self.history.at(frame.t_s)
        wall = self._walls.wall(pose) if pose is not None else None
        if pose is None or wall is None:
            return None
        # The right sonar of a robot that stands askew may measure another wall than the camera sees
        foot = wall.foot(pose)
        mapped_rad = self.map.normal_rad(foot)
        if mapped_rad is None:
            return (pose, wall) if wall.measured else None
        return (pose, wall) if abs(wrap_angle(mapped_rad - foot.normal_rad)) < SKEW_MAX_RAD else None

    def _look_at_preview(self, frame: Frame, now_s: float, holding: bool) -> None:
        if self.turning:
            self._doors.turned()
            return
        place = self._beside(frame)
        if place is None or now_s - frame.t_s > FRAME_AGE_MAX_S:
            return
        pose, wall = place
        image = frame.image
        camera = self._preview_camera
        if image.shape[1::-1] != PREVIEW_SIZE_PX:
            image = cv2.resize(image, PREVIEW_SIZE_PX, interpolation=cv2.INTER_AREA)
        self.imaged.add(pose, wall, camera, now_s)
        self.wall_m = wall.distance_m
        look_for_doors(image, camera, pose, wall, self._doors, self.records, self._driven_m, now_s)
        spaced = self._driven_m - self._full_at_m >= min(FULL_SPACING_M, FULL_SPACING_RAD * wall.distance_m)
        if holding:
            spaced = now_s - self._full_at_s >= STANDING_SPACING_S
        if not spaced or self.worker.pending >= JOBS_AT_ONCE:
            return
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        if any(self._worth_reading(box, camera, pose, wall) for box in sign_candidates(gray, camera, wall.distance_m)):
            self._full_at_m, self._full_at_s = self._driven_m, now_s
            self._source.request_full()

    def _worth_reading(self, box: Box, camera: CameraModel, pose: Pose2, wall: WallLine) -> bool:
        point = wall.point(pose, camera.bearing_rad(box.centre_px[0]))
        if point is None:
            return False
        sign = self.records.sign_at(point)
        return sign is None or not sign.settled

    def _send_to_reader(self, frame: Frame, now_s: float) -> None:
        place = self._beside(frame)
        if place is None or self.turning:
            return
        pose, wall = place
        camera = self._camera_of(frame)
        small = cv2.resize(frame.image, PREVIEW_SIZE_PX, interpolation=cv2.INTER_AREA)
        gray = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        factor = frame.image.shape[1] / PREVIEW_SIZE_PX[0]
        sent: list[float] = []
        for box in sign_candidates(gray, self._preview_camera, wall.distance_m):
            whole = box.scaled(factor)
            near = any(abs(whole.centre_px[0] - u) * camera.metres_per_px(wall.distance_m) < 0.3 for u in sent)
            if near or not self._worth_reading(box, self._preview_camera, pose, wall):
                continue
            if self.worker.pending >= JOBS_MAX:
                _log.info("reading=behind dropped_job_t_s=%.2f", now_s)
                return
            sent.append(whole.centre_px[0])
            self.worker.begin(Job(frame, pose, wall, whole), now_s)

    def _record(self, reading: Reading, now_s: float) -> None:
        job = reading.job
        self.engine_missing = not reading.read
        if not reading.read:
            return
        self.photos_read += 1
        if not reading.findings:
            point = self._point(job, job.candidate.centre_px[0])
            if point is not None:
                self.records.add_blank(point, now_s)
        placed = [(f, point) for f in reading.findings if (point := self._point(job, f.u_px)) is not None]
        seen = [
            (point, finding.reading, atan2(job.pose.y_m - point.y_m, job.pose.x_m - point.x_m))
            for finding, point in placed
        ]
        for (finding, _), sign in zip(placed, self.records.add_photo(seen, now_s), strict=True):
            sign.distance_m = job.wall.distance_m
            quality = self._quality(finding, job.frame.image.shape[1])
            if quality > sign.photo_quality:
                sign.photo, sign.photo_quality = jpeg(job.frame.image), quality

    def _quality(self, finding: Finding, width_px: int) -> float:
        """Rank of a photo: sharp, and not far from the middle of the picture; larger is better."""
        aside = abs(finding.u_px / width_px - 0.5)
        return finding.sharpness.gradient * (1.0 - aside)

    def _point(self, job: Job, u_px: float) -> WallPoint | None:
        """On the wall beside the robot; None for what hangs on another wall before it."""
        point = job.wall.point(job.pose, self._camera_of(job.frame).bearing_rad(u_px))
        return point if point is not None and not self.map.hides(point, job.pose) else None

    def _camera_of(self, frame: Frame) -> CameraModel:
        """The lens in the size that the source gave, which need not be that which was requested."""
        return self._full_camera.resized(frame.image.shape[1], frame.image.shape[0])


def jpeg(image: Image) -> bytes:
    """The photo of a record: the whole view, small."""
    small = cv2.resize(image, PREVIEW_SIZE_PX, interpolation=cv2.INTER_AREA)
    works, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, PHOTO_QUALITY])
    return data.tobytes() if works else b""
