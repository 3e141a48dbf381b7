"""Node `poi` on a bus: its records, requests and status."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np
import pytest

from common.bus import LocalMesh
from common.config import PoiSection
from common.constants import CAMERA_HEIGHT_M
from common.errors import ErrorCode
from common.geometry import Pose2
from common.messages.health import Status
from common.messages.mapping import MapUpdate, PoseEstimate, Trajectory
from common.messages.motion import Ranges
from common.messages.points_of_interest import PoiCommand, PointOfInterest, PoiRequest
from common.messages.stop import Permit
from common.messages.topics import MAP, PERMIT, POI, POSE, RANGES, RETAKE, STATUS, TRAJECTORY
from common.side_work import JobOutcome
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.camera.frame import Frame, Image
from onboard.poi.camera.sharpness import Sharpness
from onboard.poi.doors.published import PublishedRecords
from onboard.poi.placement.wall_line import WallPoint
from onboard.poi.poi import Poi, reader_of
from onboard.poi.retake import Phase, Retake, after, begin, pose_before
from onboard.poi.signs.number_forms import RoomNumber
from onboard.poi.signs.reading_job import Finding, Job, Reading, deferred_reading
from onboard.poi.signs.sign_reading import SignReading, Verdict
from onboard.poi.survey import JOBS_MAX

WALL_M = 1.2
DOOR_M, PLATE_M = (2.5, 3.5), 2.2  # along x on the wall at y = -WALL_M; x grows with the drive
SPEED_M_S = 0.16


class Wall:
    """A frame source: the wall on the right of a robot that stands at `x_m`, with a door and a plate."""

    def __init__(self) -> None:
        self.x_m = 0.0
        self.lost = False
        self.frozen_at_m: float | None = None
        self.plain = False  # without a plate
        self._due_s = 0.0
        self._wanted = False
        self.fulls = 0
        self._drawn: tuple[float, Image] | None = None

    def preview(self, now_s: float) -> Frame | None:
        if self.lost or now_s < self._due_s:
            return None
        self._due_s = now_s + 0.4
        x_m = self.x_m if self.frozen_at_m is None else self.frozen_at_m
        if self._drawn is None or self._drawn[0] != x_m:
            self._drawn = x_m, self._draw(640, 480, x_m)
        return Frame(now_s, self._drawn[1])

    def request_full(self) -> None:
        self._wanted = True

    def full(self, now_s: float) -> Frame | None:
        if not self._wanted or self.lost:
            return None
        self._wanted = False
        self.fulls += 1
        return Frame(now_s, self._draw(1280, 960, self.x_m))

    def close(self) -> None:
        """Nothing is held open."""

    def _draw(self, width: int, height: int, robot_m: float) -> Image:
        camera = CameraModel(width, height)
        image = np.full((height, width, 3), (222, 230, 232), np.uint8)
        # The robot's front is left in the picture
        x_m = robot_m - (np.arange(width) + 0.5 - width / 2) * camera.metres_per_px(WALL_M)
        image[:, (x_m > DOOR_M[0]) & (x_m < DOOR_M[1])] = (62, 104, 150)
        low, high = (int(camera.row_px(z, WALL_M)) for z in (CAMERA_HEIGHT_M + 0.02, CAMERA_HEIGHT_M - 0.02))
        stripes = (abs(x_m - PLATE_M) < 0.06) & ((x_m * 100).astype(int) % 2 == 0)
        if not self.plain:
            image[low:high, stripes] = 20
        return image


class Story:
    """The node, its wall, and a drive past it. `reads` is the text on every photo of the plate."""

    def __init__(self, reads: list[SignReading], file: Path | None = None, shift_m: float = 0.0) -> None:
        """`file`: of the records; `shift_m`: so far along x on the map all of it stands."""
        self.wall, self.now_s, self.shift_m = Wall(), 0.0, shift_m
        self.mesh = LocalMesh()
        self.bus, self.others = self.mesh.endpoint("poi"), self.mesh.endpoint("test")
        self.jobs: list[Job] = []
        self._reads = reads
        worker = deferred_reading(lambda: self._read)
        self.node = Poi(PoiSection(), self.wall, worker, published=PublishedRecords(file))
        for topic in (POI, RETAKE):
            self.others.take(topic)
        self.records: dict[int, PointOfInterest] = {}
        self.requests: list[PoiRequest] = []
        self.publish_map()

    def publish_map(self) -> None:
        points = np.array([(self.shift_m + x / 10, -WALL_M) for x in range(-10, 80)], np.float32)
        self.others.publish(MAP, MapUpdate(self.now_s, 1, 0, points, np.zeros(len(points), np.uint8)))

    def _read(self, job: Job) -> Reading:
        reading = self._reads[min(len(self.jobs), len(self._reads) - 1)]
        self.jobs.append(job)
        u_px, _ = job.candidate.centre_px
        return Reading(job, (Finding(reading, u_px, Sharpness(100.0, 50.0, 0.1)),))

    def step(self, speed_m_s: float = SPEED_M_S) -> None:
        self.now_s = round(self.now_s + 0.05, 9)
        self.mesh.now_s = self.now_s
        self.wall.x_m += 0.05 * speed_m_s
        if round(self.now_s * 20) % 2 == 0:
            at = (self.shift_m + self.wall.x_m, 0.0, 0.0, 0.0)
            self.others.publish(POSE, PoseEstimate(self.now_s, *at, 0.02, 0.01, 1))
            right = (np.nan, np.nan, np.nan, np.nan, WALL_M)
            self.others.publish(RANGES, Ranges(self.now_s, right, (0.0,) * 5))
        self.node.step(self.bus, self.now_s)
        self.records |= {record.poi_id: record for record in self.others.take(POI)}
        self.requests += self.others.take(RETAKE)

    def drive_to(self, x_m: float) -> None:
        while self.wall.x_m < x_m:
            self.step()

    def stand(self, seconds: float) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.step(0.0)

    def status(self) -> Status:
        status = self.others.latest(STATUS["poi"])
        assert status is not None
        return status


def plate(number: str) -> SignReading:
    return SignReading(
        Verdict.PLATE, RoomNumber(number, "plain"), "Office", 0.99, (0.0, 0.0, 1.0, 1.0), (number, "Office")
    )


def unclear() -> SignReading:
    return SignReading(Verdict.UNCLEAR, None, "", 0.0, (0.0, 0.0, 1.0, 1.0), ("3",))


@pytest.mark.requirement("POI_MR_01", "POI_MR_04")
def test_door_that_is_passed_becomes_one_record_with_number_place_and_photo() -> None:
    story = Story([plate("304")])
    story.drive_to(5.5)
    (record,) = story.records.values()
    assert (record.name, record.number, record.description, record.room_type) == ("Door", "304", "304", "Office")
    assert record.state == "read"
    assert (record.x_m, record.y_m) == pytest.approx((sum(DOOR_M) / 2, -WALL_M), abs=0.05)
    assert record.photo_jpeg.startswith(b"\xff\xd8")
    assert story.requests == []


def test_plate_that_is_settled_costs_no_further_frames() -> None:
    story = Story([plate("304")])
    story.drive_to(5.5)
    assert len(story.jobs) == story.wall.fulls
    assert 2 <= story.wall.fulls <= 4


def test_near_to_a_wall_photos_are_taken_at_shorter_distances(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "WALL_M", 0.6)
    story = Story([unclear()])
    story.drive_to(PLATE_M + 0.2)
    assert story.wall.fulls >= 5  # in the 0.4 m of path on which the plate is in view


@pytest.mark.requirement("POI_MR_05")
def test_plate_that_cannot_be_read_is_visited_again_and_photographed_standing() -> None:
    story = Story([unclear()] * 8 + [plate("304")])
    story.drive_to(4.2)
    request = story.requests[0]
    assert request.command is PoiCommand.GOTO
    assert (request.x_m, request.y_m, request.heading_rad) == pytest.approx((PLATE_M, 0.0, 0.0), abs=0.1)
    story.wall.x_m = request.x_m  # the planner has driven there
    story._reads = [plate("304")]
    story.stand(4.0)
    assert [r.command for r in story.requests] == [PoiCommand.GOTO, PoiCommand.STOP, PoiCommand.CONTINUE]
    story.drive_to(4.2)  # what was read standing is confirmed in passing
    assert [r.number for r in story.records.values() if r.state == "read"] == ["304"]


@pytest.mark.requirement("POI_MR_05")
def test_wall_beside_a_door_that_the_camera_has_not_seen_is_visited_for_the_doors_plate() -> None:
    story = Story([plate("304")])
    story.wall.x_m = 4.6
    while story.wall.x_m > 3.02:  # back to where the door is in view, and its plate is not
        story.step(-SPEED_M_S)
    story.stand(2.0)
    story.drive_to(5.5)
    request = story.requests[0]
    assert request.command is PoiCommand.GOTO
    assert (request.x_m, request.y_m, request.heading_rad) == pytest.approx((PLATE_M, 0.0, 0.0), abs=0.15)
    story.wall.x_m = request.x_m  # the planner has driven there
    story.stand(8.0)
    story.drive_to(5.5)
    assert [(r.state, r.number) for r in story.records.values()] == [("read", "304")]
    assert [r.command for r in story.requests].count(PoiCommand.GOTO) == 1


def test_door_beside_which_nothing_hangs_is_visited_for_no_plate() -> None:
    story = Story([plate("304")])
    story.wall.plain = True
    story.drive_to(5.5)
    assert [record.state for record in story.records.values()] == ["unread"]
    assert story.requests == []


def doubtful(number: str) -> SignReading:
    """Of a form that is not the site's."""
    shown = RoomNumber(number, "building-room")
    return SignReading(Verdict.DOUBTFUL, shown, "", 0.99, (0.0, 0.0, 1.0, 1.0), (number,))


def test_doubtful_number_is_published_as_such_with_its_photo() -> None:
    story = Story([doubtful("16-101")])
    story.drive_to(5.5)
    (record,) = story.records.values()
    assert (record.name, record.number, record.state) == ("Door", "16-101", "doubtful")
    assert record.photo_jpeg.startswith(b"\xff\xd8")
    assert story.requests == []


def test_door_that_stays_unread_is_published_after_two_visits() -> None:
    story = Story([unclear()])
    story.drive_to(4.2)
    story.stand(95.0)
    assert [r.command for r in story.requests].count(PoiCommand.GOTO) == 2
    (record,) = story.records.values()
    assert (record.state, record.number) == ("unread", "")


def after_restarts(file: Path, *drives: tuple[str, float]) -> list[PointOfInterest]:
    """Each with a process of its own, past a door with that number so far along the hall; all that they publish."""
    published = []
    for number, shift_m in drives:
        story = Story([plate(number)] if number else [unclear()], file, shift_m)
        story.drive_to(5.5)
        story.node.close()
        published += story.records.values()
    return published


def test_after_a_restart_records_keep_their_numbers_and_new_ones_go_on(tmp_path: Path) -> None:
    """What was read then is not replaced by what cannot be read now."""
    drives = ("304", 0.0), ("", 0.0), ("305", 8.0)
    records = after_restarts(tmp_path / "doors.json", *drives)
    assert [(record.poi_id, record.number) for record in records] == [(1, "304"), (2, "305")]


@pytest.mark.parametrize("text", ["", "{", "[[1, 2]]", '[[1, "x", 0, 0, "", "", "", 0]]', "[[0, 0, 0, 0, 1, 2, 3, 4]]"])
def test_where_the_file_is_damaged_numbers_begin_anew(text: str, tmp_path: Path) -> None:
    (tmp_path / "doors.json").write_text(text, encoding="utf-8")
    assert len(PublishedRecords(tmp_path / "doors.json")) == 0


@pytest.mark.parametrize("plain", [False, True], ids=["with a plate", "without one"])
def test_record_moves_with_the_map_and_is_the_same_when_the_door_is_passed_again(plain: bool) -> None:
    """A loop closure puts the hall 0.9 m further along: further than doors stand apart."""
    story = Story([plate("304")])
    story.wall.plain = plain
    story.drive_to(7.5)
    (before,) = story.records.values()
    story.shift_m = 0.9
    story.publish_map()
    times_s = np.arange(0.0, story.now_s, 2.0)
    poses = np.column_stack([0.9 + SPEED_M_S * times_s, 0.0 * times_s, 0.0 * times_s])
    story.others.publish(TRAJECTORY, Trajectory(story.now_s, times_s, poses))
    story.stand(2.0)
    (moved,) = story.records.values()
    assert (moved.x_m - before.x_m, moved.y_m) == pytest.approx((0.9, before.y_m), abs=0.03)
    assert moved.poi_id == before.poi_id
    story.wall.x_m = 0.0
    story.drive_to(7.5)
    (again,) = story.records.values()
    assert again.x_m == pytest.approx(moved.x_m, abs=0.05)
    assert again.number == before.number == ("" if plain else "304")
    assert story.requests == []


def test_lost_frames_are_an_error_that_heals_and_stops_nothing() -> None:
    story = Story([plate("304")])
    story.stand(1.0)
    assert story.status().error_code == ErrorCode.OK
    story.wall.lost = True
    story.stand(3.0)
    assert (story.status().error_code, story.status().ready) == (ErrorCode.NO_FRAMES, True)
    story.wall.lost = False
    story.stand(1.0)
    assert story.status().error_code == ErrorCode.OK


def test_camera_that_repeats_one_picture_is_an_error_and_what_it_shows_is_no_door() -> None:
    story = Story([plate("304")])
    story.wall.frozen_at_m = 2.3  # door and plate
    story.drive_to(5.5)
    assert (story.status().state, story.status().error_code) == ("BLIND", ErrorCode.FRAMES_FROZEN)
    assert [record.state for record in story.records.values() if record.state == "read"] == []
    assert len(story.jobs) <= 1
    story.wall.frozen_at_m = None
    story.stand(1.0)
    assert story.status().error_code == ErrorCode.OK


def test_robot_without_an_ocr_engine_reports_it_and_finds_doors_all_the_same() -> None:
    story = Story([plate("304")])
    story.node = Poi(PoiSection(), story.wall, deferred_reading(lambda: lambda job: Reading(job, (), read=False)))
    story.drive_to(5.5)
    assert (story.status().state, story.status().error_code) == ("LOOKING", ErrorCode.NO_OCR)
    assert [(record.state, record.number) for record in story.records.values()] == [("unread", "")]
    assert story.requests == []


def test_engine_that_cannot_be_loaded_reads_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ImportError("No module named 'rapidocr'")

    monkeypatch.setattr("onboard.poi.poi.SignReader", broken)
    story = Story([plate("304")])
    story.drive_to(3.0)
    assert reader_of(PoiSection())(story.jobs[0]) == Reading(story.jobs[0], (), read=False)


class OneAtATime:
    """A reader that takes `takes_s` for every job, and begins none before the one ahead is done."""

    ready = True

    def __init__(self, work: Callable[[Job], Reading], takes_s: float) -> None:
        self._work, self._takes_s = work, takes_s
        self._jobs: deque[tuple[float, Job]] = deque()
        self.most = 0

    @property
    def pending(self) -> int:
        return len(self._jobs)

    @property
    def busy(self) -> bool:
        return bool(self._jobs)

    def begin(self, job: Job, now_s: float) -> None:
        begins_s = self._jobs[-1][0] if self._jobs else now_s
        self._jobs.append((begins_s + self._takes_s, job))
        self.most = max(self.most, len(self._jobs))

    def result(self, now_s: float) -> JobOutcome[Reading] | None:
        return JobOutcome(self._work(self._jobs.popleft()[1])) if self._jobs and now_s >= self._jobs[0][0] else None

    def due_s(self, now_s: float) -> float:
        return self._jobs[0][0] if self._jobs else now_s

    def close(self) -> None:
        self._jobs.clear()


def test_plate_is_read_in_passing_by_a_reader_that_is_six_times_slower() -> None:
    story = Story([plate("304")])
    slow = OneAtATime(story._read, takes_s=1.5)
    story.node = Poi(PoiSection(), story.wall, slow)
    story.drive_to(5.5)
    assert [(record.state, record.number) for record in story.records.values()] == [("read", "304")]
    assert story.requests == []
    assert slow.most <= JOBS_MAX


def test_latched_stop_ends_the_taking_of_photos() -> None:
    story = Story([plate("304")])
    story.others.publish(PERMIT, Permit(0.0, False, "stopped", ("command_center",)))
    story.drive_to(4.0)
    assert story.status().state == "STOPPED"
    assert story.wall.fulls == 0


def test_nothing_is_looked_at_while_the_robot_turns() -> None:
    story = Story([plate("304")])
    story.drive_to(1.7)
    taken = story.wall.fulls
    for i in range(100):
        story.now_s = round(story.now_s + 0.05, 9)
        story.mesh.now_s = story.now_s
        story.wall.x_m = 2.2
        story.others.publish(POSE, PoseEstimate(story.now_s, 2.2, 0.0, 0.03 * i, 0.0, 0.02, 0.01, 1))
        story.node.step(story.bus, story.now_s)
    assert story.wall.fulls <= taken + 1


# The retake's state machine


def test_pose_for_a_photo_is_square_to_the_wall() -> None:
    goal = pose_before(WallPoint(2.0, 0.0, pi / 2), 1.1)
    assert (goal.x_m, goal.y_m, goal.heading_rad) == pytest.approx((2.0, 1.1, 0.0), abs=1e-9)
    assert pose_before(WallPoint(2.0, 0.0, pi / 2), 9.0).y_m == pytest.approx(1.5)


def test_retake_holds_only_when_there_standing_and_facing() -> None:
    goal = Pose2(1.0, 0.0, 0.0)
    state, command = begin(goal, 0.0)
    assert (state.phase, command) == (Phase.DRIVING, PoiCommand.GOTO)
    for pose, motion in (
        (Pose2(3.0, 0.0, 0.0), (0.0, 0.0)),
        (Pose2(1.0, 0.0, 1.0), (0.0, 0.0)),
        (goal, (0.16, 0.0)),
        (goal, (0.0, 0.5)),
    ):
        assert after(state, pose, motion, 0, 1.0) == (state, None)
    assert after(state, goal, (0.0, 0.0), 0, 1.0) == (Retake(Phase.HOLDING, goal, 1.0), PoiCommand.STOP)


def test_retake_ends_by_photos_or_by_time() -> None:
    holding = Retake(Phase.HOLDING, Pose2(0.0, 0.0, 0.0), 10.0)
    assert after(holding, Pose2(0.0, 0.0, 0.0), (0.0, 0.0), 3, 11.0) == (Retake(), PoiCommand.CONTINUE)
    assert after(holding, Pose2(0.0, 0.0, 0.0), (0.0, 0.0), 0, 19.0) == (Retake(), PoiCommand.CONTINUE)
    driving = Retake(Phase.DRIVING, Pose2(9.0, 0.0, 0.0), 10.0)
    assert after(driving, Pose2(0.0, 0.0, 0.0), (0.1, 0.0), 0, 99.0) == (Retake(), PoiCommand.CONTINUE)
