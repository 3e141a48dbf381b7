"""A program of ROS 2 that knows nothing of the project: prints what it has received as JSON, then publishes two wishes.

Arguments: x and y of a pose and a goal, and the topics that it waits for, for a while. Of `/tf` it reads bytes, by the
type that the project made, since no wheel has any.
"""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Range
from visualization_msgs.msg import MarkerArray

from offboard.ros.tf_message import message_class

PATIENCE_S = 20.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)


def place(pose) -> list[float]:
    return [pose.position.x, pose.position.y]


READERS = {
    "/map": (
        OccupancyGrid,
        LATCHED,
        lambda m: {
            "size": [m.info.width, m.info.height],
            "origin": place(m.info.origin),
            "cell_m": m.info.resolution,
            "cells": {str(value): list(m.data).count(value) for value in (-1, 0, 100)},
        },
    ),
    "/pose": (PoseWithCovarianceStamped, 10, lambda m: {"frame": m.header.frame_id, "place": place(m.pose.pose)}),
    "/path": (Path, LATCHED, lambda m: [place(at.pose) for at in m.poses]),
    "/doors": (MarkerArray, LATCHED, lambda m: {k.text: place(k.pose) for k in m.markers if k.text}),
    **{
        f"/range/{name}": (Range, 10, lambda m: {"frame": m.header.frame_id, "range": m.range, "max": m.max_range})
        for name in ("left", "front_left", "front", "front_right", "right")
    },
}


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("listener")
    received = {}
    for topic, (kind, profile, read) in READERS.items():
        node.create_subscription(kind, topic, lambda m, t=topic, r=read: received.__setitem__(t, r(m)), profile)
    of_tf = message_class(PoseStamped)
    for topic, profile in (("/tf", 10), ("/tf_static", LATCHED)):
        keep = lambda data, t=topic: received.__setitem__(t, data.hex())  # noqa: E731
        node.create_subscription(of_tf, topic, keep, profile, raw=True)
    goals = node.create_publisher(PoseStamped, "/goal_pose", 10)
    x_m, y_m, *wanted = sys.argv[1:]
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s and not set(wanted) <= set(received):
        rclpy.spin_once(node, timeout_sec=0.1)
    stated = PoseWithCovarianceStamped()
    stated.header.frame_id = "map"
    stated.pose.pose.position.x, stated.pose.pose.position.y = float(x_m), float(y_m)
    stated.pose.pose.orientation.z = stated.pose.pose.orientation.w = 0.5**0.5
    stated.pose.covariance[0] = stated.pose.covariance[7] = 0.25
    stated.pose.covariance[35] = 0.0685
    node.create_publisher(PoseWithCovarianceStamped, "/initialpose", 10).publish(stated)
    rclpy.spin_once(node, timeout_sec=1.0)
    for frame in ("odom", "map"):
        goal = PoseStamped()
        goal.header.frame_id = frame
        goal.pose.position.x, goal.pose.position.y = float(x_m), float(y_m)
        goals.publish(goal)
    rclpy.spin_once(node, timeout_sec=1.0)
    hashes = {}
    for topic in ("/tf", "/tf_static"):
        published = node.get_publishers_info_by_topic(topic)
        hashes[topic] = [[info.topic_type, str(info.topic_type_hash)] for info in published]
    print(json.dumps(received | {"types": hashes}), flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
