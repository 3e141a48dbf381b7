"""Node `poi` on the Raspberry Pi: pose, echoes and camera in; one record per door, and requests for another photo, out.

Reads POSE, RANGES, MAP, TRAJECTORY and PERMIT, and frames from its source. Writes POI (an event when a door was read,
or was passed unread), RETAKE (to the planner), status and log. A latched stop ends the taking of photos until it is
released.
"""

from __future__ import annotations

import logging
from math import hypot, radians
from typing import Any

from common.board_state import BoardReporter
from common.bus import Bus
from common.config import PoiSection
from common.errors import ErrorCode
from common.geometry import Pose2
from common.messages.points_of_interest import PointOfInterest, PoiRequest
from common.messages.topics import PERMIT, POI, RETAKE, Topic
from common.status import StatusReporter
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import FULL_SIZE_PX
from onboard.poi.camera.frame_source import FrameSource
from onboard.poi.doors.door_association import Door, State
from onboard.poi.doors.door_detection import ColourBox
from onboard.poi.doors.observations import Place, move
from onboard.poi.doors.published import SAME_RECORD_M, PublishedRecords
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.retake import VISITS_MAX, Phase, Retake, after, begin, plate_spots, pose_before
from onboard.poi.signs.ocr_engine import SignReader
from onboard.poi.signs.reading_job import Read, Reading, ReadingWorker, read
from onboard.poi.signs.sign_reading import sign_rules
from onboard.poi.signs.site_numbers import SiteNumbers, site_numbers
from onboard.poi.survey import Survey

RECORD_PERIOD_S = 1.0  # between two searches for records to publish
PASSED_M = 1.6  # from there on a door is out of view
PASSED_S = 20.0  # or was not observed for so long
MOVED_M = 0.04  # a record whose place changed less is not published again
RETAKE_NEAR_M = 4.0  # the robot does not drive further back than this
BLIND = (ErrorCode.NO_FRAMES, ErrorCode.FRAMES_FROZEN, ErrorCode.FRAMES_DARK, ErrorCode.FRAMES_BRIGHT)
DOOR, NAME_TAG = "Door", "Name Tag"

_log = logging.getLogger("poi")


def reader_of(section: PoiSection) -> Read:
    """Loads the models; returns the function that reads one job. Without an engine it reads nothing, and reports so."""
    try:
        reader = SignReader()
    except (ImportError, OSError, RuntimeError) as error:
        _log.error("reading=impossible reason=%s", error)
        return lambda job: Reading(job, (), read=False)
    rules = sign_rules(section)
    camera = CameraModel(*FULL_SIZE_PX, radians(section.field_of_view_deg))
    return lambda job: read(job, reader, rules, camera)


class Poi:
    """Node "poi". `worker` decides whether it reads beside the loop or in simulated time; `board` reports on the
    computer.
    """

    name = "poi"
    period_s = 0.05
    wakes_on: tuple[Topic[Any], ...] = ()

    def __init__(
        self,
        section: PoiSection,
        source: FrameSource,
        worker: ReadingWorker,
        board: BoardReporter | None = None,
        published: PublishedRecords | None = None,
    ) -> None:
        boxes = tuple(ColourBox.parse(text) for text in section.door_colours)
        self._survey = Survey(source, worker, boxes, radians(section.field_of_view_deg), site_numbers(section))
        self._status = StatusReporter(self.name)
        self._board = board
        self._retake = Retake()
        self._photos_before = 0
        self._visits: list[Place] = []
        self._published = PublishedRecords() if published is None else published
        self._record_due_s = 0.0
        self._proposal = ""

    def step(self, bus: Bus, now_s: float) -> None:
        permit = bus.latest(PERMIT)
        stopped = permit is not None and bool(permit.stop_sources)
        for shift in self._survey.receive(bus, now_s):
            self._published.move(shift)
            move(self._visits, shift)
        if stopped:
            self._survey.health.paused(now_s)
        else:
            self._survey.look(now_s, holding=self._retake.phase is Phase.HOLDING)
        pose = self._survey.history.newest
        if pose is not None and not stopped:
            self._go_on_with_retake(bus, now_s, pose)
            if now_s >= self._record_due_s:
                self._record_due_s = now_s + RECORD_PERIOD_S
                doors = self._survey.records.doors()
                self._report_proposal(self._survey.records.site)
                self._publish_records(bus, now_s, pose, doors)
                self._request_retake(bus, now_s, pose, doors)
        self._published.step(now_s)
        self._report(bus, now_s, stopped)
        if self._board is not None:
            self._board.report(bus, now_s)

    def close(self) -> None:
        self._published.close()
        self._survey.close()

    def _report_proposal(self, site: SiteNumbers) -> None:
        if site.proposed and not self._proposal:
            _log.info("numbers form=%s learned=%s: %s", site.proposed, site.learned, site.proposal)
        self._proposal = site.proposed

    def _publish_records(self, bus: Bus, now_s: float, pose: Pose2, doors: list[Door]) -> None:
        for door in doors:
            # Until both edges were seen the middle of the door is a guess
            certain = door.state is State.READ and len(door.edges) == 2
            if not certain and not self._passed(door.centre, door.seen_s, pose, now_s):
                continue
            last = self._published.of(door) or self._published.begin(door)
            if not last.improves(door):
                continue
            sign = door.sign
            content = (door.state.value, sign.number if sign else "", sign.room_type if sign else "")
            quality = sign.photo_quality if sign else 0.0
            moved_m = last.sent.distance_m(door.centre)
            if content == last.content and moved_m < MOVED_M:
                continue
            photo = sign.photo if sign is not None and quality > last.quality else b""
            last.place, last.sent = Place.of(door.centre, door.seen_s), door.centre
            last.sign, last.content = sign, content
            last.quality = max(quality, last.quality)
            self._published.changed()
            bus.publish(POI, _record(door, last.poi_id, photo, now_s))

    def _passed(self, point: WallPoint, seen_s: float, pose: Pose2, now_s: float) -> bool:
        away_m = hypot(point.x_m - pose.x_m, point.y_m - pose.y_m)
        return self._retake.phase is Phase.IDLE and (away_m > PASSED_M or now_s - seen_s > PASSED_S)

    def _request_retake(self, bus: Bus, now_s: float, pose: Pose2, doors: list[Door]) -> None:
        """Requests a drive back to a sign that was observed and not read, or to where a door's plate may hang unseen.

        Once it is out of view, and where it is near and in sight.
        """
        if self._retake.phase is not Phase.IDLE or self._survey.turning or self._survey.worker.pending:
            return
        read_near = [door.centre for door in doors if door.state is State.READ]
        signs = [(sign.place.point, sign.distance_m) for sign in self._survey.records.signs if sign.wants_photo]
        unseen = [
            (spot, self._survey.wall_m)
            for door in doors
            if door.sign is None and door.state is State.UNREAD
            for spot in plate_spots(door.centre, door.width_m)
            if not self._survey.imaged.holds(spot)
        ]
        for spot, distance_m in signs + unseen:
            away_m = hypot(spot.x_m - pose.x_m, spot.y_m - pose.y_m)
            if (
                PASSED_M < away_m < RETAKE_NEAR_M
                and self._visits_of(spot) < VISITS_MAX
                and not any(spot.distance_m(centre) < PASSED_M for centre in read_near)
            ):
                goal = pose_before(self._survey.map.facing(spot), distance_m)
                # A place behind a wall is near in a straight line only
                if self._survey.map.in_sight(pose, goal):
                    self._visits.append(Place.of(spot, now_s))
                    self._retake, command = begin(goal, now_s)
                    bus.publish(RETAKE, PoiRequest(now_s, command, goal.x_m, goal.y_m, goal.heading_rad))
                    return

    def _visits_of(self, spot: WallPoint) -> int:
        return sum(visited.point.distance_m(spot) < SAME_RECORD_M for visited in self._visits)

    def _go_on_with_retake(self, bus: Bus, now_s: float, pose: Pose2) -> None:
        survey = self._survey
        if self._retake.phase is not Phase.HOLDING:
            self._photos_before = survey.photos_read
        taken = survey.photos_read - self._photos_before
        self._retake, command = after(self._retake, pose, survey.history.motion(), taken, now_s)
        if command is not None:
            bus.publish(RETAKE, PoiRequest(now_s, command))

    def _report(self, bus: Bus, now_s: float, stopped: bool) -> None:
        """A fault of camera or engine is an error and no reason to stop: the robot maps without them."""
        survey = self._survey
        fault = survey.health.fault(now_s)
        state = "STOPPED" if stopped else "BLIND" if fault in BLIND else self._retake.phase.name
        if state == Phase.IDLE.name:
            state = "LOOKING"
        if fault is ErrorCode.OK and survey.engine_missing:
            fault = ErrorCode.NO_OCR
        self._status.report(
            bus,
            now_s,
            state=state,
            error=fault,
            ready=survey.worker.ready,
            detail=f"{len(self._published)} doors" + (f", numbers are {self._proposal}" if self._proposal else ""),
        )


def _record(door: Door, poi_id: int, photo: bytes, now_s: float) -> PointOfInterest:
    sign = door.sign
    return PointOfInterest(
        t_s=now_s,
        poi_id=poi_id,
        name=DOOR if door.edges else NAME_TAG,
        description=sign.number if sign is not None else "",
        x_m=door.centre.x_m,
        y_m=door.centre.y_m,
        number=sign.number if sign is not None else "",
        room_type=sign.room_type if sign is not None else "",
        confidence=round(sign.best_confidence * sign.share, 4) if sign is not None and sign.legible else 0.0,
        state=door.state.value,
        photo_jpeg=photo,
    )
