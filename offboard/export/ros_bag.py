"""The run as a ROS 2 bag, stored as MCAP: what navigation and RViz know (`ros_messages`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer

from common.messages.topics import LOG, ODOMETRY, POI, POSE, RANGES, TRAJECTORY
from offboard.export import ros_messages
from offboard.export.occupancy_image import CELL_M, image_of_run
from offboard.export.ros_messages import LATCHED, STORE, Sent, serialized, type_of
from offboard.export.run_time import RunTime
from offboard.runs.run_database import Message, RunReader

_NEVER = QosTime(9_223_372_036, 854_775_807)
_TRANSIENT_LOCAL = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_NEVER,
    lifespan=_NEVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_NEVER,
    avoid_ros_namespace_conventions=False,
)
_LOGS = tuple(LOG.values())


def write_bag(run_dir: Path, folder: Path) -> None:
    with RunReader(run_dir) as run, Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        time, bag = RunTime(run), _Bag(writer)
        last_ns: int | None = None
        for message in run.display_data():
            now_ns = time.of(message)
            if last_ns is None:
                bag.add(ros_messages.of_sonar_frames(now_ns), now_ns)
            last_ns = max(last_ns or now_ns, now_ns)
            for sent in _messages(message, now_ns, time):
                bag.add(sent, now_ns)
        if last_ns is not None:
            image = image_of_run(run_dir)
            origin_m = image.origin_x_m, image.origin_y_m
            bag.add(ros_messages.of_map(last_ns, image.grid_cells(), origin_m, CELL_M), last_ns)


class _Bag:
    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._connections: dict[str, Any] = {}

    def add(self, sent: Sent, time_ns: int) -> None:
        topic, message = sent
        if topic not in self._connections:
            profiles = [_TRANSIENT_LOCAL] if topic in LATCHED else []
            self._connections[topic] = self._writer.add_connection(
                topic, type_of(message), typestore=STORE, offered_qos_profiles=profiles
            )
        self._writer.write(self._connections[topic], time_ns, serialized(message))


def _messages(message: Message[Any], now_ns: int, time: RunTime) -> Iterator[Sent]:
    payload = message.payload
    if message.topic is POSE:
        yield from ros_messages.of_pose(now_ns, payload)
    elif message.topic is ODOMETRY:
        yield ros_messages.of_odometry(now_ns, payload)
    elif message.topic is RANGES:
        yield from ros_messages.of_ranges(now_ns, payload)
    elif message.topic is TRAJECTORY:
        stamps_ns = [time.at(message, t_s) for t_s in np.asarray(payload.times_s).tolist()]
        yield ros_messages.of_path(now_ns, stamps_ns, np.asarray(payload.poses).reshape(-1, 3).tolist())
    elif message.topic is POI:
        yield ros_messages.of_doors(now_ns, [payload])
        if payload.photo_jpeg:
            yield ros_messages.of_photo(now_ns, payload.photo_jpeg)
    elif message.topic in _LOGS:
        yield ros_messages.of_log_line(now_ns, message.topic.producer, payload.level, payload.text)
