"""From columns of a picture to points on the wall: camera model, pose at the frame's time, wall line, wall map."""

from __future__ import annotations

from math import cos, inf, nan, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.geometry import Pose2
from common.messages.mapping import MapUpdate, PoseEstimate, Trajectory
from onboard.poi.camera.camera_model import CameraModel
from onboard.poi.placement.map_shift import BelievedPath, MapShift
from onboard.poi.placement.pose_history import PoseHistory
from onboard.poi.placement.wall_line import WallLine, WallPoint, WallTracker
from onboard.poi.placement.wall_map import WallMap

CAMERA = CameraModel(1280, 960)


def estimate(t_s: float, x_m: float, y_m: float = 0.0, heading_rad: float = 0.0) -> PoseEstimate:
    return PoseEstimate(t_s, x_m, y_m, heading_rad, heading_rad, 0.02, 0.01, 1)


def driven_along(distance_m: float, skew_rad: float = 0.0, noise_m: float = 0.0) -> tuple[WallTracker, Pose2]:
    """Two metres along a wall on the right; the robot's heading stands `skew_rad` off the wall."""
    tracker, rng = WallTracker(), np.random.default_rng(3)
    pose = Pose2(0.0, 0.0, skew_rad)
    for x_m in np.arange(0.0, 2.0, 0.016):
        gap_m = distance_m + x_m * sin(skew_rad)
        pose = Pose2(x_m * cos(skew_rad), gap_m, skew_rad)
        tracker.add(pose, gap_m + rng.normal(0.0, noise_m))
    return tracker, pose


@given(st.floats(0.0, 1280.0))
def test_column_and_bearing_are_inverse(u_px: float) -> None:
    assert CAMERA.column_px(CAMERA.bearing_rad(u_px)) == pytest.approx(u_px, abs=1e-6)


def test_left_of_the_picture_is_ahead_of_the_robot() -> None:
    assert CAMERA.bearing_rad(640.0) == pytest.approx(-pi / 2)
    assert CAMERA.bearing_rad(0.0) == pytest.approx(-pi / 2 + 0.47)


def test_row_and_height_are_inverse() -> None:
    assert CAMERA.height_m(CAMERA.row_px(1.1, 1.4), 1.4) == pytest.approx(1.1)
    assert CAMERA.height_m(480.0, 2.0) == pytest.approx(1.45)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, -90.0])
def test_ray_meets_the_wall_in_every_direction(heading_deg: float) -> None:
    pose = Pose2(3.0, 2.0, radians(heading_deg))
    point = WallLine(1.2, 0.0).point(pose, -pi / 2)
    assert point is not None
    expected = pose.transform([0.0, -1.2])
    assert (point.x_m, point.y_m) == pytest.approx(tuple(expected))
    assert cos(point.normal_rad - (pose.heading_rad + pi / 2)) == pytest.approx(1.0)


def test_flat_ray_meets_no_wall() -> None:
    assert WallLine(1.2, 0.0).range_m(-pi / 2 + 1.2) is None


@pytest.mark.parametrize("skew_deg", [0.0, 4.0, -8.0])
def test_wall_line_follows_the_echoes_of_the_right_sonar(skew_deg: float) -> None:
    tracker, pose = driven_along(1.1, radians(skew_deg), noise_m=0.01)
    wall = tracker.wall(pose)
    assert wall is not None
    point = wall.point(pose, -pi / 2)
    assert point is not None
    assert point.y_m == pytest.approx(0.0, abs=0.04)
    assert wall.along_rad == pytest.approx(-radians(skew_deg), abs=0.04)


def test_echoes_of_several_walls_are_no_wall() -> None:
    tracker = WallTracker()
    rng = np.random.default_rng(5)
    for x_m in np.arange(0.0, 1.0, 0.02):
        tracker.add(Pose2(x_m, 0.0, 0.0), 1.0 + rng.uniform(0.0, 0.2))
    assert tracker.wall(Pose2(0.5, 0.0, 0.0)) is None


def test_without_echoes_there_is_no_wall() -> None:
    tracker = WallTracker()
    for x_m in range(10):
        tracker.add(Pose2(0.1 * x_m, 0.0, 0.0), nan)
    assert tracker.wall(Pose2(0.5, 0.0, 0.0)) is None


def test_pose_at_a_frames_time_lies_between_its_neighbours() -> None:
    history = PoseHistory()
    for i in range(5):
        history.add(estimate(0.1 * i, 0.016 * i, heading_rad=pi - 0.01 + 0.005 * i), now_s=0.1 * i)
    pose = history.at(0.25)
    assert pose is not None
    assert pose.x_m == pytest.approx(0.04)
    assert history.at(5.0) is None
    assert not history.covers(0.5)


def test_clocks_of_two_boards_are_separated_by_their_offset() -> None:
    history = PoseHistory()
    for i in range(20):
        history.add(estimate(1000.0 + 0.1 * i, 0.016 * i), now_s=0.1 * i + (0.01 if i == 7 else 0.05))
    pose = history.at(0.5 + 0.01)
    assert pose is not None
    assert pose.x_m == pytest.approx(0.08, abs=1e-6)


def test_motion_is_unknown_before_two_poses_and_measured_after() -> None:
    history = PoseHistory()
    assert history.motion()[1] > 1e3
    for i in range(6):
        history.add(estimate(0.1 * i, 0.0, heading_rad=0.1 * i), now_s=0.1 * i)
    speed_m_s, rate_rad_s = history.motion()
    assert (speed_m_s, rate_rad_s) == pytest.approx((0.0, 1.0))


TIMES_S = np.array([1.0, 2.0, 3.0])
POSES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [2.0, 1.0, 3.1]])
poses_on_maps = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-pi, pi))


@given(st.lists(poses_on_maps, min_size=3, max_size=3), poses_on_maps, st.floats(1.0, 9.0))
def test_what_was_seen_moves_with_the_keyframe_before_it(
    now: list[tuple[float, float, float]], place: tuple[float, float, float], seen_s: float
) -> None:
    moved = MapShift(TIMES_S, POSES, np.array(now)).moved(np.array([place]), [seen_s])
    node = min(int(seen_s), 3) - 1
    seen = Pose2.from_array(POSES[node]).between(Pose2(*place))
    expected = Pose2(*now[node]).compose(seen)
    assert Pose2.from_array(moved[0]).distance_m(expected) < 1e-6
    assert cos(moved[0, 2] - expected.heading_rad) == pytest.approx(1.0)


@pytest.mark.parametrize("times_s", [TIMES_S, [5.0, 9.0, 2.0]], ids=["one session", "two sessions of the board"])
def test_what_was_seen_before_the_keyframes_of_the_session_stays(times_s: list[float]) -> None:
    shift = MapShift(np.array(times_s), POSES, POSES + 1.0)
    assert shift.moved(np.zeros((2, 3)), [0.5, -inf]).tolist() == np.zeros((2, 3)).tolist()


def test_a_path_is_compared_with_where_it_lay_before_and_at_first_with_where_the_robot_was() -> None:
    path, history = BelievedPath(), PoseHistory()
    for i in range(35):
        history.add(estimate(1000.0 + 0.1 * i, 0.1 * i), now_s=0.1 * i)

    def moved_m(*x_m: float) -> list[float]:
        """Of something that was seen from each keyframe."""
        poses = np.array([(x, 0.0, 0.0) for x in x_m])
        shift = path.update(Trajectory(0.0, 1001.0 + np.arange(len(x_m)), poses), history)
        return shift.moved(np.zeros((len(x_m), 3)), 1.0 + np.arange(len(x_m)))[:, 0].tolist()

    assert moved_m(1.1, 2.2) == pytest.approx([0.1, 0.2])
    assert moved_m(1.1, 2.3, 3.5) == pytest.approx([0.0, 0.1, 0.5])
    assert moved_m(1.1, 2.3, 3.5, 9.0) == pytest.approx([0.0, 0.0, 0.0, 0.0])  # where it was then is not known


def wall_map(points: list[tuple[float, float]]) -> WallMap:
    walls = WallMap()
    walls.add(MapUpdate(0.0, 1, 0, np.array(points, np.float32), np.zeros(len(points), np.uint8)))
    return walls


def test_mouth_of_a_side_hall_has_no_wall_behind_it() -> None:
    along = [(x / 10, 0.0) for x in range(50) if not 20 < x < 30]
    left, right = WallPoint(3.0, 0.0, pi / 2), WallPoint(2.0, 0.0, pi / 2)
    assert not wall_map(along).backs(left, right)
    assert wall_map([(x / 10, 0.05) for x in range(50)]).backs(left, right)


def test_wall_that_stands_before_a_point_hides_it_and_its_own_wall_does_not() -> None:
    own = [(x / 20, 0.0) for x in range(60)]
    corner = [(1.5, y / 20) for y in range(10, 20)]
    behind, pose = WallPoint(2.2, 0.0, pi / 2), Pose2(1.2, 1.2, 0.0)
    assert not wall_map(own).hides(behind, pose)
    assert wall_map(own + corner).hides(behind, pose)
    assert not wall_map([*own, (1.6, 0.72)]).hides(behind, pose)  # a single point may be a person


def test_direction_of_the_map_replaces_a_skewed_one() -> None:
    walls = wall_map([(x / 10, 0.0) for x in range(30)])
    assert walls.facing(WallPoint(1.5, 0.0, pi / 2 + 0.4)).normal_rad == pytest.approx(pi / 2, abs=0.02)
    assert walls.facing(WallPoint(9.0, 0.0, 0.4)).normal_rad == 0.4


def test_path_through_a_wall_is_not_in_sight() -> None:
    walls = wall_map([(x / 10, 0.0) for x in range(30)])
    assert not walls.in_sight(Pose2(1.0, 1.0, 0.0), Pose2(1.5, -1.0, 0.0))
    assert walls.in_sight(Pose2(1.0, 1.0, 0.0), Pose2(2.5, 1.0, 0.0))
