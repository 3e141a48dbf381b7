"""The robot in a graph of ROS 2, without ROS: what a stand-in of the graph is given, and what becomes of its goals."""

from __future__ import annotations

import zlib
from argparse import Namespace
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from math import inf, nan, pi
from typing import Any

import numpy as np
import pytest

from common.bus import LocalMesh
from common.config import Config
from common.config_file import ConfigError, parse_config
from common.errors import StartError
from common.grid_cells import FREE, WALL
from common.messages.mapping import GridUpdate, PoseEstimate, Trajectory
from common.messages.mission import Operation
from common.messages.motion import Ranges
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import GRID, POI, POSE, RANGES, STATUS, TRAJECTORY
from offboard.export.ros_messages import STORE, Sent, serialized, type_of
from offboard.operate.bus_operator import OperatorView
from offboard.operate.operations import Order
from offboard.ros.__main__ import make_ros
from offboard.ros.driven_path import POSES_MAX, DrivenPath
from offboard.ros.ros import Goal, InitialPose, Ros, standard_deviations
from offboard.ros.wall_time import WallTime

BEGAN_S = 1_700_000_000.0
NS = 1_000_000_000


class StandIn:
    """Of the graph: what was published, as a subscriber decodes it; `wishes` come next."""

    def __init__(self) -> None:
        self.received: dict[str, list[Any]] = defaultdict(list)
        self.wishes: list[Goal | InitialPose] = []

    def publish(self, sent: Sent) -> None:
        topic, message = sent
        self.received[topic].append(STORE.deserialize_cdr(serialized(message), type_of(message)))

    def take_wishes(self) -> list[Goal | InitialPose]:
        wishes, self.wishes = self.wishes, []
        return wishes

    def close(self) -> None:
        """It holds nothing."""


class Orders:
    """The way of every order: what was given."""

    def __init__(self, on_view: Callable[[OperatorView], None]) -> None:
        self.on_view = on_view
        self.given: list[Order] = []

    def operate(self, order: Order) -> None:
        self.given.append(order)

    def open(self) -> None:
        """No thread here."""

    def close(self) -> None:
        """No thread here."""

    def stop(self) -> None:
        raise AssertionError("nothing in the graph stops")


class Scene:
    """The node on a bus, beside a robot; time passes by `step`."""

    def __init__(self, *, network: bool = False) -> None:
        self.mesh, self.graph = LocalMesh(), StandIn()
        self.robot, self.bus = self.mesh.endpoint("robot"), self.mesh.endpoint("ros")
        self.orders: Orders | None = None
        self.node = Ros(self.graph, lambda: BEGAN_S + self.mesh.now_s, None if network else self._operator)
        self.step()

    def _operator(self, on_view: Callable[[OperatorView], None]) -> Orders:
        self.orders = Orders(on_view)
        return self.orders

    def step(self, seconds: float = 0.1) -> None:
        self.mesh.now_s += seconds
        self.node.step(self.bus, self.mesh.now_s)

    def newest(self, topic: str) -> Any:
        return self.graph.received[topic][-1]


def pose(t_s: float, x_m: float, y_m: float = 0.0, heading_rad: float = 0.0, *, valid: bool = True) -> PoseEstimate:
    return PoseEstimate(t_s, x_m, y_m, heading_rad, 0.0, 0.05, 0.01, 1, valid)


def door(poi_id: int, number: str, x_m: float = 3.0) -> PointOfInterest:
    return PointOfInterest(0.0, poi_id, "Door", "", x_m, 1.0, number, "Office", 0.9, "read")


def seconds(stamp: Any) -> float:
    return float(stamp.sec) + stamp.nanosec / NS


def test_a_pose_comes_with_its_uncertainty_and_as_the_transform_from_map_to_robot() -> None:
    scene = Scene()
    scene.robot.publish(POSE, pose(0.1, 2.0, -1.0, pi / 2))
    scene.step()
    at = scene.newest("/pose")
    assert at.header.frame_id == "map"
    assert (at.pose.pose.position.x, at.pose.pose.position.y) == (2.0, -1.0)
    assert (at.pose.covariance[0], at.pose.covariance[35]) == pytest.approx((0.0025, 0.0001))
    (transform,) = scene.newest("/tf").transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base_link")
    assert transform.transform.rotation.z == pytest.approx(0.5**0.5)
    assert transform.header.stamp == at.header.stamp


def test_the_covariance_of_a_pose_is_an_ellipse_on_the_map() -> None:
    scene = Scene()
    scene.robot.publish(POSE, replace(pose(0.1, 2.0), sd_xy_m=0.3, sd_least_m=0.1, worst_rad=pi / 4))
    scene.step()
    covariance = scene.newest("/pose").pose.covariance
    assert covariance[[0, 1, 6, 7]] == pytest.approx([0.05, 0.04, 0.04, 0.05])
    assert standard_deviations(covariance)[0] == pytest.approx(0.3)


def test_a_robot_that_does_not_know_where_it_is_sends_no_pose() -> None:
    scene = Scene()
    scene.robot.publish(POSE, pose(0.1, 2.0, valid=False))
    scene.step()
    assert not scene.graph.received["/pose"]
    assert not scene.graph.received["/tf"]


def test_five_sonars_stand_in_their_frames_and_no_echo_is_infinite() -> None:
    scene = Scene()
    frames = {frame.child_frame_id for frame in scene.newest("/tf_static").transforms}
    scene.robot.publish(RANGES, Ranges(0.1, (1.0, 2.0, nan, 2.0, 1.0), (0.0,) * 5))
    scene.step()
    ranges = {topic: scene.newest(topic) for topic in list(scene.graph.received) if topic.startswith("/range/")}
    assert len(ranges) == 5
    assert {message.header.frame_id for message in ranges.values()} == frames
    assert (ranges["/range/left"].range, ranges["/range/front"].range) == (1.0, inf)


def test_the_map_is_the_robots_own_grid_in_the_numbers_of_ros() -> None:
    scene = Scene()
    cells = np.zeros((3, 4), np.uint8)
    cells[0, 1], cells[2, 3] = FREE, WALL
    scene.robot.publish(GRID, GridUpdate(0.1, 1, -1.5, 0.5, 0.1, 3, 4, zlib.compress(cells.tobytes())))
    scene.step()
    grid = scene.newest("/map")
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (4, 3, pytest.approx(0.1))
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.5, 0.5)
    assert np.asarray(grid.data).reshape(3, 4).tolist() == [[-1, 0, -1, -1], [-1] * 4, [-1, -1, -1, 100]]
    scene.step()
    assert len(scene.graph.received["/map"]) == 1


def test_a_grid_that_cannot_be_unpacked_is_left_out() -> None:
    scene = Scene()
    scene.robot.publish(GRID, GridUpdate(0.1, 1, 0.0, 0.0, 0.1, 3, 4, zlib.compress(b"short")))
    scene.step()
    assert not scene.graph.received["/map"]


def test_doors_are_markers_of_which_the_newest_message_has_all() -> None:
    scene = Scene()
    scene.robot.publish(POI, door(1, "101"))
    scene.step()
    scene.robot.publish(POI, door(2, ""))
    scene.robot.publish(POI, door(1, "101a", 4.0))
    scene.step(2.0)
    texts = {(m.id, m.text): m.pose.position.x for m in scene.newest("/doors").markers if m.ns == "numbers"}
    assert texts == {(1, "101a Office"): 4.0, (2, "? Office"): 3.0}


def test_the_path_is_smoothed_as_far_as_that_reaches_and_then_as_it_was_driven() -> None:
    scene = Scene()
    scene.robot.publish(TRAJECTORY, Trajectory(1.0, np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [1.0, 0.5, 0]])))
    for k in range(20):
        scene.robot.publish(POSE, pose(0.5 + 0.1 * k, 0.5 + 0.1 * k))
    scene.step(3.0)
    path = scene.newest("/path")
    xs = [at.pose.position.x for at in path.poses]
    assert xs[:2] == [0.0, 1.0]
    assert xs[-1] == pytest.approx(2.4)
    stamps_s = [seconds(at.header.stamp) for at in path.poses]
    assert np.all(np.diff(stamps_s) > 0)
    assert seconds(scene.newest("/pose").header.stamp) == pytest.approx(stamps_s[-1])


def test_a_path_of_any_length_is_a_bounded_message_that_ends_where_the_robot_is() -> None:
    path = DrivenPath()
    times_s = np.arange(40_000.0)
    path.take_trajectory(Trajectory(0.0, times_s, np.column_stack([times_s, 0 * times_s, 0 * times_s])))
    poses = path.poses()
    assert POSES_MAX / 2 < len(poses) <= POSES_MAX
    assert poses[-1, 1] == 39_999.0
    assert np.all(np.diff(poses[:, 0]) > 0)


def test_a_goal_in_the_maps_frame_is_an_order_by_the_way_of_all_orders() -> None:
    scene = Scene()
    scene.graph.wishes = [Goal("map", 3.0, -1.5)]
    scene.step()
    assert scene.orders is not None
    assert scene.orders.given == [Order(Operation.GOTO, 3.0, -1.5)]
    scene.orders.on_view(OperatorView("IDLE", "The planner took the goto."))
    scene.step()
    status = scene.robot.latest(STATUS["ros"])
    assert status is not None
    assert status.detail == "The planner took the goto."


@pytest.mark.parametrize(
    "goal",
    [Goal("odom", 1.0, 1.0), Goal("", 1.0, 1.0), Goal("map", nan, 1.0), Goal("map", 1.0, inf), Goal("map", 1e9, 0)],
)
def test_a_goal_that_is_no_place_of_the_map_is_refused_with_a_reason(
    goal: Goal, caplog: pytest.LogCaptureFixture
) -> None:
    scene = Scene()
    scene.graph.wishes = [goal]
    scene.step()
    assert scene.orders is not None
    assert scene.orders.given == []
    assert "a goal was refused" in caplog.text


def test_an_initial_pose_is_an_order_with_its_doubt() -> None:
    scene = Scene()
    scene.graph.wishes = [InitialPose("map", 3.0, -1.5, pi / 2, 0.5, 0.26)]
    scene.step()
    assert scene.orders is not None
    assert scene.orders.given == [Order(Operation.POSE, 3.0, -1.5, heading_rad=pi / 2, sd_m=0.5, sd_heading_rad=0.26)]


@pytest.mark.parametrize(
    "pose", [InitialPose("odom", 1.0, 1.0, 0.0, 0.5, 0.3), InitialPose("map", 1.0, 1.0, 0.0, nan, nan)]
)
def test_an_initial_pose_without_frame_or_covariance_is_refused_with_a_reason(
    pose: InitialPose, caplog: pytest.LogCaptureFixture
) -> None:
    scene = Scene()
    scene.graph.wishes = [pose]
    scene.step()
    assert scene.orders is not None
    assert scene.orders.given == []
    assert "a pose was refused" in caplog.text


def test_a_covariance_is_taken_by_its_worst_direction() -> None:
    covariance = [0.0] * 36
    covariance[0], covariance[1], covariance[6], covariance[7], covariance[35] = 0.25, 0.24, 0.24, 0.25, 0.04
    assert standard_deviations(covariance) == pytest.approx((0.7, 0.2))
    covariance[0] = covariance[7] = -1.0
    assert all(sd != sd for sd in standard_deviations(covariance))


def test_while_no_order_can_be_given_a_goal_is_refused_and_does_not_wait() -> None:
    scene = Scene()
    assert scene.orders is not None
    scene.orders.on_view(OperatorView("LINK_LOST", "", "No mesh answers."))
    scene.graph.wishes = [Goal("map", 1.0, 1.0)]
    scene.step()
    scene.orders.on_view(OperatorView("IDLE"))
    scene.step()
    assert scene.orders.given == []


def test_where_programs_of_other_machines_can_publish_nobody_can_order_anything() -> None:
    scene = Scene(network=True)
    scene.graph.wishes = [Goal("map", 1.0, 1.0)]
    scene.step()
    assert scene.orders is None
    status = scene.robot.latest(STATUS["ros"])
    assert status is not None
    assert status.detail == "no orders from here"


def test_stamps_follow_the_soonest_message_and_a_clock_that_begins_anew() -> None:
    time = WallTime()
    for k, late_s in enumerate([0.2, 0.01, 0.3, 0.05]):
        time.take(10.0 + k, 1000.0 + k + late_s)
        last_ns = time.of(10.0 + k)
    assert last_ns / NS == pytest.approx(1003.01, abs=0.01)
    time.take(0.5, 1004.0)
    assert time.of(0.5) / NS == pytest.approx(1004.0)


def test_the_process_runs_only_where_it_is_named() -> None:
    assert "ros" not in parse_config("").processes
    named = '[laptop]\nprocesses = ["recorder", "visualizer", "command_center", "ros"]'
    assert "ros" in parse_config(named).processes
    with pytest.raises(ConfigError, match="visualizer"):
        parse_config('[laptop]\nprocesses = ["recorder", "command_center", "ros"]')


@pytest.mark.skipif(find_spec("rclpy") is not None, reason="ROS is installed")
def test_without_ros_the_process_ends_with_one_sentence_that_names_what_installs_it() -> None:
    with pytest.raises(StartError, match=r"needs rclpy.*indoor-mapping\[ros\]"):
        make_ros(Config(), Namespace())
