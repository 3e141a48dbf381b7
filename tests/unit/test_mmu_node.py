"""The mapping unit as a node: a drive around an island, message by message; the feet of walls echo."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import inf, nan, pi, radians
from typing import Any

import numpy as np
import pytest

from common.bus import ALIVE_PERIODS, LocalMesh
from common.constants import (
    MAP_DENSITY_PER_M,
    MAP_RATE_MAX_HZ,
    MAP_TOLERANCE_M,
    TICK_M,
    WHEEL_TRACK_M,
)
from common.errors import ErrorCode
from common.geometry import Points, Pose2, wrap_angle
from common.messages.health import Status
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.motion import Odometry, Ranges
from common.messages.topics import GRID, MAP, ODOMETRY, POSE, RANGES, STATUS, TRAJECTORY
from common.node import Agenda
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.mmu import MappingUnit
from tests.unit.mmu_scenes import ranges_to, ring

PERIOD_S = 0.1
SPEED_M_S = 0.3
TURN_RAD_S = 1.0
START = Pose2(3.0, 0.9, 0.0)
GYRO_DRIFT_RAD_S = radians(0.02)
CORNERS = ((7.1, 0.9), (7.1, 5.1), (0.9, 5.1), (0.9, 0.9))  # of the path


WALLS = np.array(ring(0.0, 0.0, 8.0, 6.0) + ring(1.8, 1.8, 6.2, 4.2))


def ranges_at(pose: Pose2) -> tuple[float, ...]:
    return ranges_to(pose, WALLS)


def path(rounds: int = 1, beyond_m: float = 6.0) -> Iterator[tuple[float, Pose2]]:
    """True poses ten times a second, with the speed at each: round the island, then a little further."""
    yield from way(START, [*CORNERS * rounds, (START.x_m, START.y_m), (START.x_m + beyond_m, START.y_m)])


def way(pose: Pose2, goals: list[tuple[float, float]]) -> Iterator[tuple[float, Pose2]]:
    """True poses ten times a second from there to each of the goals, with the speed at each."""
    for x_m, y_m in goals:
        while abs(off_rad := pose.bearing_rad(x_m, y_m)) > 0.01 and pose.distance_m(Pose2(x_m, y_m, 0.0)) > 0.1:
            turn_rad = max(-TURN_RAD_S * PERIOD_S, min(TURN_RAD_S * PERIOD_S, off_rad))
            pose = pose.compose(Pose2(0.0, 0.0, turn_rad))
            yield 0.0, pose
        while (to_go_m := pose.distance_m(Pose2(x_m, y_m, 0.0))) > 1e-6:
            pose = pose.compose(Pose2(min(SPEED_M_S * PERIOD_S, to_go_m), 0.0, 0.0))
            yield SPEED_M_S, pose


@dataclass
class Bench:
    """A mapping unit on a mesh, and everything that it publishes."""

    mesh: LocalMesh = field(default_factory=LocalMesh)
    unit: MappingUnit = field(default_factory=lambda: MappingUnit(deferred_back_end()))
    poses: list[PoseEstimate] = field(default_factory=list)
    maps: list[MapUpdate] = field(default_factory=list)
    statuses: list[Status] = field(default_factory=list)
    truth: list[Pose2] = field(default_factory=list)
    left_m: float = 0.0
    right_m: float = 0.0
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        self.bus = self.mesh.endpoint("mmu")
        self.receiver = self.mesh.endpoint("receiver")
        self.receive()

    @property
    def now_s(self) -> float:
        return self.mesh.now_s

    def receive(self) -> None:
        self.poses += self.receiver.take(POSE)
        self.maps += self.receiver.take(MAP)
        self.statuses += self.receiver.take(STATUS["mmu"])

    def step(self) -> None:
        """Half a period and one step of the node."""
        self.mesh.now_s += PERIOD_S / 2
        self.unit.step(self.bus, self.now_s)
        self.receive()

    def report(self, speed_m_s: float, pose: Pose2, ranges_late: bool = False) -> None:
        """What the bridge reports once the robot is at that true pose, and two steps of the node."""
        before = self.truth[-1] if self.truth else pose
        turned_rad = wrap_angle(pose.heading_rad - before.heading_rad)
        moved_m = pose.distance_m(before)
        self.left_m += moved_m - turned_rad * WHEEL_TRACK_M / 2
        self.right_m += moved_m + turned_rad * WHEEL_TRACK_M / 2
        self.yaw_rad = wrap_angle(self.yaw_rad + turned_rad + GYRO_DRIFT_RAD_S * PERIOD_S * (len(self.truth) > 0))
        self.truth.append(pose)
        odometry = Odometry(
            self.now_s,
            round(self.left_m / TICK_M),
            round(self.right_m / TICK_M),
            self.yaw_rad,
            0.0,
            0.0,
            0.0,
            speed_m_s,
            moved_m == turned_rad == 0.0,
            False,
            False,
            session=0,
        )
        ranges = Ranges(self.now_s, ranges_at(pose), (0.0,) * 5)
        self.bus.publish(ODOMETRY, odometry)
        if ranges_late:
            self.step()
        self.bus.publish(RANGES, ranges)
        if not ranges_late:
            self.step()
        self.step()

    def drive(self, seconds: float = inf, **options: Any) -> Bench:
        for i, (speed_m_s, pose) in enumerate(path()):
            if i * PERIOD_S > seconds:
                break
            self.report(speed_m_s, pose, **options)
        return self

    def received_map(self) -> Points:
        """The map as a receiver of the increments holds it."""
        points = np.zeros((0, 2))
        for update in self.maps:
            assert update.start in (0, len(points))
            assert update.inferred.shape == (len(update.points_m),)
            points = np.concatenate([points[: update.start], update.points_m])
        return points


@pytest.fixture(scope="module")
def driven() -> Bench:
    """Once round the island and beyond the start."""
    return Bench().drive()


def wall_distance_m(points: Points) -> np.ndarray:
    a, d = WALLS[None, :, :2], (WALLS[:, 2:] - WALLS[:, :2])[None]
    share = np.clip(((points[:, None] - a) * d).sum(axis=2) / (d * d).sum(axis=2), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points[:, None] - a - share[..., None] * d, axis=2).min(axis=1))


@pytest.mark.requirement("MMU_MR_02", "MMU_SR_04")
def test_pose_stays_true_all_the_way_round(driven: Bench) -> None:
    poses = driven.poses[-len(driven.truth) :]
    off_m = [START.compose(Pose2(p.x_m, p.y_m, 0.0)).distance_m(t) for p, t in zip(poses, driven.truth, strict=True)]
    assert max(off_m) < 0.4
    assert off_m[-1] < 0.2
    assert all(pose.valid for pose in poses)


def test_the_doubt_of_the_pose_holds_its_error_and_is_smaller_where_walls_measure_it(driven: Bench) -> None:
    poses = driven.poses[-len(driven.truth) :]
    chi2 = []
    for pose, truth in zip(poses[50:], driven.truth[50:], strict=True):
        on_map = START.between(truth)
        xx, xy, yy = pose.covariance
        error = np.array([pose.x_m - on_map.x_m, pose.y_m - on_map.y_m])
        chi2.append(error @ np.linalg.solve([[xx, xy], [xy, yy]], error))
    assert np.percentile(chi2, 95) < 5.99  # of two degrees of freedom
    assert np.mean([pose.sd_least_m / pose.sd_xy_m for pose in poses[50:]]) < 0.8
    assert max(pose.sd_xy_m for pose in poses) < 0.3


@pytest.mark.requirement("MMU_MR_03")
def test_wall_points_lie_on_walls(driven: Bench) -> None:
    distance_m = wall_distance_m(START.transform(driven.received_map()))
    assert np.percentile(distance_m, 95) < 0.2
    assert distance_m.max() < MAP_TOLERANCE_M


@pytest.mark.requirement("MMU_MR_01")
def test_walls_driven_along_are_dense_with_points(driven: Bench) -> None:
    points = START.transform(driven.received_map())
    outer = points[(np.abs(points[:, 1]) < 0.3) & (points[:, 0] > 2.0) & (points[:, 0] < 6.5)]
    assert np.diff(np.sort(outer[:, 0])).max() < 0.1


def test_increments_join_up_and_a_correction_of_the_past_begins_again(driven: Bench) -> None:
    assert driven.maps[0].start == 0
    revisions = [update.revision for update in driven.maps]
    assert revisions == sorted(revisions)
    assert revisions[-1] > revisions[0], "coming round the island must have corrected something"
    for before, update in zip(driven.maps, driven.maps[1:], strict=False):
        joins = update.start == before.start + len(before.points_m)
        assert update.start == 0 if update.revision != before.revision else joins
    received = driven.received_map()
    snapshot = next(u for u in reversed(driven.maps) if u.start == 0)
    assert len(received) >= len(snapshot.points_m) > 100


def test_map_is_published_at_most_twice_a_second(driven: Bench) -> None:
    sent_s = np.array([update.t_s for update in driven.maps])
    assert np.diff(sent_s).min() >= 1.0 / MAP_RATE_MAX_HZ - 1e-6


def test_pose_comes_with_every_report_and_holds_the_yaw_it_belongs_to(driven: Bench) -> None:
    assert len(driven.poses) >= len(driven.truth)
    assert driven.poses[-1].yaw_rad == pytest.approx(driven.yaw_rad)


def test_grid_shows_the_hall_free_and_the_walls(driven: Bench) -> None:
    update = driven.receiver.latest(GRID)
    assert update is not None
    cells = np.frombuffer(zlib.decompress(update.cells_zlib), np.uint8).reshape(update.rows, update.columns)

    def cell(x_m: float, y_m: float) -> int:
        place = START.inverse().transform([x_m, y_m])
        row, column = (place[::-1] - [update.origin_y_m, update.origin_x_m]) // update.cell_m
        return int(cells[int(row), int(column)])

    assert cell(5.0, 0.9) == 1
    assert cell(0.9, 3.0) == 1
    wall = np.argwhere(cells == 2)
    corner = np.array([update.origin_x_m, update.origin_y_m])
    centres = START.transform((wall[:, ::-1] + 0.5) * update.cell_m + corner)
    assert np.percentile(wall_distance_m(centres), 90) < 0.25


def test_trajectory_follows_the_path(driven: Bench) -> None:
    trajectory = driven.receiver.latest(TRAJECTORY)
    assert trajectory is not None
    assert trajectory.poses.shape == (len(trajectory.times_s), 3)
    assert (np.diff(trajectory.times_s) > 0).all()


@pytest.mark.requirement("MMU_MR_02")
def test_pose_turns_invalid_when_odometry_stops_and_comes_back() -> None:
    bench = Bench().drive(seconds=3.0)
    assert bench.poses[-1].valid
    assert bench.statuses[-1].ready
    for _ in range(20):
        bench.step()
    assert not bench.poses[-1].valid
    assert not bench.statuses[-1].ready
    assert bench.statuses[-1].error_code == ErrorCode.NO_ODOMETRY
    bench.report(0.0, bench.truth[-1])
    assert bench.poses[-1].valid
    assert bench.statuses[-1].ready


class Sleeper:
    """A mapping unit that is stepped when it makes itself due, looked at every millisecond."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.bench.bus.wake_on(self.bench.unit.wakes_on)
        self.agenda, self.steps_s = Agenda(self.bench.unit, 0.0), list[float]()

    def run(self, seconds: float) -> None:
        bench, agenda = self.bench, self.agenda
        for _ in range(round(seconds * 1000)):
            bench.mesh.now_s = now_s = round(bench.now_s + 0.001, 9)
            if now_s >= agenda.due_s or (bench.bus.woken and now_s >= agenda.earliest_s):
                bench.bus.woken = False
                agenda.stepped(now_s, bench.unit.step(bench.bus, now_s))
                self.steps_s.append(now_s)
                bench.receive()

    def report(self, seconds: float, period_s: float, seed: int = 1) -> None:
        """Reports of a robot that stands, some milliseconds early or late."""
        random = np.random.default_rng(seed)
        for _ in range(round(seconds / period_s)):
            odometry = Odometry(self.bench.now_s, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, True, False, False, session=0)
            self.bench.bus.publish(ODOMETRY, odometry)
            self.bench.bus.publish(RANGES, Ranges(self.bench.now_s, (1.0,) * 5, (0.0,) * 5))
            self.run(period_s + float(random.uniform(-0.004, 0.004)))


@pytest.mark.parametrize("period_s", [0.099, 0.1, 0.101], ids=["fast", "even", "slow"])
def test_one_step_for_each_report_does_all_that_is_due(period_s: float) -> None:
    """However a board's clock and this one's differ."""
    sleeper, seconds = Sleeper(), 30.0
    sleeper.report(seconds, period_s)
    assert len(sleeper.steps_s) < 1.08 * seconds / period_s
    at_s = np.array([status.t_s for status in sleeper.bench.statuses])
    assert len(at_s) == pytest.approx(seconds / 0.1, rel=0.02)
    assert np.diff(at_s).max() < 0.16


@pytest.mark.requirement("MMU_MR_02")
def test_pose_turns_invalid_within_a_hundredth_of_a_second_after_odometry_is_too_old() -> None:
    sleeper = Sleeper()
    sleeper.report(2.0, 0.1)
    stopped_s = sleeper.bench.now_s
    sleeper.run(1.0)
    first = next(status for status in sleeper.bench.statuses if status.t_s > stopped_s and not status.ready)
    age_s = ALIVE_PERIODS / ODOMETRY.rate_hz
    assert age_s - 0.11 < first.t_s - stopped_s < age_s + 0.011
    assert not sleeper.bench.poses[-1].valid
    at_s = np.array([status.t_s for status in sleeper.bench.statuses])
    assert np.diff(at_s).max() < 0.16, "the status keeps its rate where no odometry comes"


def test_unit_waits_for_odometry_and_reports_it() -> None:
    bench = Bench()
    for _ in range(5):
        bench.step()
    assert bench.poses == []
    assert bench.maps == []
    assert bench.statuses[-1].state == "WAITING"
    assert not bench.statuses[-1].ready


def test_status_comes_ten_times_a_second() -> None:
    bench = Bench().drive(seconds=5.0)
    assert len(bench.statuses) == pytest.approx(50, abs=5)


def test_invalid_odometry_moves_nothing() -> None:
    bench = Bench().drive(seconds=3.0)
    published = len(bench.poses)
    newest = bench.bus.latest(ODOMETRY)
    assert newest is not None
    bench.bus.publish(ODOMETRY, replace(newest, t_s=bench.now_s, ticks_left=0, ticks_right=0, valid=False))
    bench.step()
    assert len(bench.poses) == published


def test_same_messages_give_the_same_map_to_the_bit() -> None:
    a, b = Bench().drive(seconds=12.0), Bench().drive(seconds=12.0)
    assert a.received_map().tobytes() == b.received_map().tobytes()
    assert a.poses == b.poses


def test_ranges_that_arrive_one_step_after_their_odometry_still_count() -> None:
    bench = Bench().drive(seconds=8.0, ranges_late=True)
    assert len(bench.received_map()) > 20


def test_a_sonar_that_is_broken_leaves_the_others_working(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = ranges_at
    monkeypatch.setitem(globals(), "ranges_at", lambda pose: (nan, *whole(pose)[1:]))
    points = START.transform(Bench().drive(seconds=12.0).received_map())
    assert (np.abs(points[:, 1]) < 0.2).sum() > 3.0 * MAP_DENSITY_PER_M


def test_heading_of_the_start_is_the_first_axis_of_the_map() -> None:
    bench = Bench()
    turned = Pose2(START.x_m, START.y_m, pi / 2)
    bench.report(0.0, turned)
    bench.report(SPEED_M_S, turned.compose(Pose2(0.03, 0.0, 0.0)))
    assert bench.poses[-1].x_m == pytest.approx(0.03, abs=1e-3)
    assert bench.poses[-1].y_m == pytest.approx(0.0, abs=1e-3)
