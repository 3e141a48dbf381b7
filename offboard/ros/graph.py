"""The graph of ROS 2 by rclpy: the only module that imports it. Publishers by topic; goals and poses that came.

Messages come as bytes, so that they are the same as those of a bag. Unless `network` of `[ros]` is true, DDS finds
programs on this machine only, and Fast DDS opens no port to any other.
"""

from __future__ import annotations

import logging
import os
from importlib import import_module
from importlib.util import find_spec
from math import atan2
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
from offboard.ros.ros import Goal, InitialPose, standard_deviations

NODE = "indoor_mapping"
WISHES_AT_ONCE = 10  # of one step; the newest count
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
        self._wishes: list[Goal | InitialPose] = []
        self._node.create_subscription(PoseStamped, "/goal_pose", self._take_goal, 10)
        self._node.create_subscription(PoseWithCovarianceStamped, "/initialpose", self._take_pose, 10)

    def publish(self, sent: Sent) -> None:
        topic, message = sent
        if topic not in self._publishers:
            self._publishers[topic] = self._publisher(topic, type_of(message))
        publisher = self._publishers[topic]
        if publisher is not None:
            publisher.publish(serialized(message))

    def take_wishes(self) -> list[Goal | InitialPose]:
        for _ in range(WISHES_AT_ONCE):
            before = len(self._wishes)
            self._executor.spin_once(timeout_sec=0.0)
            if len(self._wishes) == before:
                break
        wishes, self._wishes = self._wishes, []
        return wishes

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

    def _take_pose(self, stated: PoseWithCovarianceStamped) -> None:
        at, turn = stated.pose.pose.position, stated.pose.pose.orientation
        heading_rad = atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
        sds = standard_deviations(stated.pose.covariance)
        self._wishes.append(InitialPose(stated.header.frame_id, at.x, at.y, heading_rad, *sds))

    def _take_goal(self, goal: PoseStamped) -> None:
        place = goal.pose.position
        self._wishes.append(Goal(goal.header.frame_id, place.x, place.y))


def _class_of(kind: str) -> Any:
    """Of `nav_msgs/msg/Path`, the class that rclpy knows. Raises ImportError and what `message_class` raises."""
    package, _, name = kind.split("/")
    if package == tf_message.PACKAGE and find_spec(package) is None:
        return tf_message.message_class(PoseStamped)
    return getattr(import_module(f"{package}.msg"), name)
