"""The graph of ROS 2 by rclpy: the only module that imports it. Publishers by topic, and the goals that came.

Messages come as bytes, so that they are the same as those of a bag. Unless `network` of `[ros]` is true, DDS finds
programs on this machine only, and Fast DDS opens no port to any other.
"""

from __future__ import annotations

import logging
import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from subprocess import SubprocessError
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from offboard.export.ros_messages import LATCHED, Sent, serialized, type_of
from offboard.ros import tf_message
from offboard.ros.ros import Goal

NODE = "indoor_mapping"
GOALS_AT_ONCE = 10  # of one step; the newest count
LOOPBACK = Path(__file__).with_name("loopback.xml")

_log = logging.getLogger("ros")


def _profile(topic: str) -> QoSProfile:
    latched = topic in LATCHED
    return QoSProfile(
        depth=1 if latched else 10,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class RclpyGraph:
    """One thread at a time."""

    def __init__(self, *, network: bool) -> None:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET" if network else "LOCALHOST"
        if not network:
            os.environ["FASTDDS_DEFAULT_PROFILES_FILE"] = str(LOOPBACK)
        # Signals are those of the process (common/process.py)
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(NODE)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._publishers: dict[str, Any] = {}
        self._goals: list[Goal] = []
        self._node.create_subscription(PoseStamped, "/goal_pose", self._take_goal, 10)
        self._node.create_subscription(PoseWithCovarianceStamped, "/initialpose", self._refuse_pose, 10)

    def publish(self, sent: Sent) -> None:
        topic, message = sent
        if topic not in self._publishers:
            self._publishers[topic] = self._publisher(topic, type_of(message))
        publisher = self._publishers[topic]
        if publisher is not None:
            publisher.publish(serialized(message))

    def take_goals(self) -> list[Goal]:
        for _ in range(GOALS_AT_ONCE):
            before = len(self._goals)
            self._executor.spin_once(timeout_sec=0.0)
            if len(self._goals) == before:
                break
        goals, self._goals = self._goals, []
        return goals

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _publisher(self, topic: str, kind: str) -> Any:
        """None where this installation of ROS lacks the type: then one topic is missing, and the log names it."""
        try:
            message_class = _class_of(kind)
        except (ImportError, OSError, SubprocessError) as error:
            _log.warning("not published topic=%s type=%s error=%s", topic, kind, error)
            return None
        return self._node.create_publisher(message_class, topic, _profile(topic))

    def _refuse_pose(self, _: PoseWithCovarianceStamped) -> None:
        """The mapping unit takes no pose from anybody; who sends one is to know."""
        _log.warning("a pose was refused: the robot finds its place in the map by what it measures")

    def _take_goal(self, goal: PoseStamped) -> None:
        place = goal.pose.position
        self._goals.append(Goal(goal.header.frame_id, place.x, place.y))


def _class_of(kind: str) -> Any:
    """Of `nav_msgs/msg/Path`, the class that rclpy knows. Raises ImportError and what `message_class` raises."""
    package, _, name = kind.split("/")
    if package == tf_message.PACKAGE and find_spec(package) is None:
        return tf_message.message_class(PoseStamped)
    return getattr(import_module(f"{package}.msg"), name)
