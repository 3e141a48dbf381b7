"""The run as a ROS 2 bag, stored as MCAP: what navigation and RViz know, in ROS's own types and frames (REP 103, 105).

`map` is the map's frame, `base_link` the robot, `sonar_*` its sonars, whose ranges count from the robot's centre.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import cos, inf, isnan, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from common.constants import SONAR_BEARINGS_RAD, SONAR_MAX_M, SONAR_NAMES, SONAR_RANGE_MIN_M
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import LOG, ODOMETRY, POI, POSE, RANGES, TRAJECTORY
from offboard.export.occupancy_image import CELL_M, FREE, OCCUPIED, OccupancyImage, image_of_run
from offboard.export.run_time import NS, RunTime
from offboard.runs.run_database import Message, RunReader

MAP_FRAME, ODOM_FRAME, ROBOT_FRAME = "map", "odom", "base_link"
SONAR_CONE_RAD = radians(45.0)  # where the sensor's data sheet sees a person
_LEVELS = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "CRITICAL": 50}  # rcl_interfaces/Log
_STORE = get_typestore(Stores.ROS2_JAZZY)
_LATCHED = ("/map", "/tf_static", "/path", "/doors")  # who subscribes late gets the newest
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

Sent = tuple[str, Any]


def write_bag(run_dir: Path, folder: Path) -> None:
    with RunReader(run_dir) as run, Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        time, bag = RunTime(run), _Bag(writer)
        last_ns: int | None = None
        for message in run.display_data():
            now_ns = time.of(message)
            if last_ns is None:
                bag.add("/tf_static", now_ns, _sonar_frames(now_ns))
            last_ns = max(last_ns or now_ns, now_ns)
            for topic, sent in _messages(message, now_ns, time):
                bag.add(topic, now_ns, sent)
        if last_ns is not None:
            bag.add("/map", last_ns, _grid(image_of_run(run_dir), last_ns))


class _Bag:
    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._connections: dict[str, Any] = {}

    def add(self, topic: str, time_ns: int, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            profiles = [_TRANSIENT_LOCAL] if topic in _LATCHED else []
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=_STORE, offered_qos_profiles=profiles
            )
        self._writer.write(self._connections[topic], time_ns, _STORE.serialize_cdr(message, kind))


def _type(name: str) -> Callable[..., Any]:
    return _STORE.types[name]


_Time, _Header = _type("builtin_interfaces/msg/Time"), _type("std_msgs/msg/Header")
_Point, _Vector, _Quaternion = (_type(f"geometry_msgs/msg/{name}") for name in ("Point", "Vector3", "Quaternion"))
_Pose = _type("geometry_msgs/msg/Pose")


def _messages(message: Message[Any], now_ns: int, time: RunTime) -> Iterator[Sent]:
    payload = message.payload
    if message.topic is POSE:
        pose = payload.x_m, payload.y_m, payload.heading_rad
        yield "/tf", _transforms(now_ns, MAP_FRAME, {ROBOT_FRAME: pose})
        yield "/pose", _pose(now_ns, pose, payload.sd_xy_m, payload.sd_heading_rad)
    elif message.topic is ODOMETRY:
        yield "/odom", _odometry(now_ns, payload)
    elif message.topic is RANGES:
        for name, range_m in zip(SONAR_NAMES, payload.range_m, strict=False):
            yield f"/range/{name}", _range(now_ns, name, range_m)
    elif message.topic is TRAJECTORY:
        stamps_ns = [time.at(message, t_s) for t_s in np.asarray(payload.times_s).tolist()]
        yield "/path", _path(now_ns, stamps_ns, np.asarray(payload.poses).reshape(-1, 3).tolist())
    elif message.topic is POI:
        yield "/doors", _markers(now_ns, payload)
        if payload.photo_jpeg:
            yield "/photos/compressed", _photo(now_ns, payload.photo_jpeg)
    elif message.topic in _LOGS:
        yield "/rosout", _log_line(now_ns, message.topic.producer, payload.level, payload.text)


_LOGS = tuple(LOG.values())


def _stamp(time_ns: int) -> Any:
    return _Time(sec=time_ns // NS, nanosec=time_ns % NS)


def _header(time_ns: int, frame: str) -> Any:
    return _Header(stamp=_stamp(time_ns), frame_id=frame)


def _rotation(heading_rad: float) -> Any:
    return _Quaternion(x=0.0, y=0.0, z=sin(heading_rad / 2), w=cos(heading_rad / 2))


def _place(x_m: float, y_m: float, heading_rad: float = 0.0, z_m: float = 0.0) -> Any:
    return _Pose(position=_Point(x=x_m, y=y_m, z=z_m), orientation=_rotation(heading_rad))


def _transforms(time_ns: int, parent: str, children: dict[str, tuple[float, float, float]]) -> Any:
    stamped, transform = _type("geometry_msgs/msg/TransformStamped"), _type("geometry_msgs/msg/Transform")
    transforms = [
        stamped(
            header=_header(time_ns, parent),
            child_frame_id=child,
            transform=transform(translation=_Vector(x=x_m, y=y_m, z=0.0), rotation=_rotation(heading_rad)),
        )
        for child, (x_m, y_m, heading_rad) in children.items()
    ]
    return _type("tf2_msgs/msg/TFMessage")(transforms=transforms)


def _sonar_frames(time_ns: int) -> Any:
    frames = {f"sonar_{name}": (0.0, 0.0, b) for name, b in zip(SONAR_NAMES, SONAR_BEARINGS_RAD, strict=True)}
    return _transforms(time_ns, ROBOT_FRAME, frames)


def _covariance(sd_xy_m: float, sd_heading_rad: float) -> Any:
    """6 x 6, row by row: x, y, z, and the rotations about them."""
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = sd_xy_m**2
    covariance[5, 5] = sd_heading_rad**2
    return covariance.ravel()


def _pose(time_ns: int, pose: tuple[float, float, float], sd_xy_m: float, sd_heading_rad: float) -> Any:
    with_covariance = _type("geometry_msgs/msg/PoseWithCovariance")(
        pose=_place(*pose), covariance=_covariance(sd_xy_m, sd_heading_rad)
    )
    return _type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=_header(time_ns, MAP_FRAME), pose=with_covariance
    )


def _odometry(time_ns: int, odometry: Any) -> Any:
    twist = _type("geometry_msgs/msg/Twist")(
        linear=_Vector(x=odometry.speed_m_s, y=0.0, z=0.0), angular=_Vector(x=0.0, y=0.0, z=odometry.yaw_rate_rad_s)
    )
    return _type("nav_msgs/msg/Odometry")(
        header=_header(time_ns, ODOM_FRAME),
        child_frame_id=ROBOT_FRAME,
        pose=_type("geometry_msgs/msg/PoseWithCovariance")(
            pose=_place(odometry.x_m, odometry.y_m, odometry.yaw_rad), covariance=np.zeros(36)
        ),
        twist=_type("geometry_msgs/msg/TwistWithCovariance")(twist=twist, covariance=np.zeros(36)),
    )


def _range(time_ns: int, name: str, range_m: float) -> Any:
    """Infinite where nothing answered (REP 117)."""
    return _type("sensor_msgs/msg/Range")(
        header=_header(time_ns, f"sonar_{name}"),
        radiation_type=0,
        field_of_view=SONAR_CONE_RAD,
        min_range=SONAR_RANGE_MIN_M,
        max_range=SONAR_MAX_M,
        range=inf if isnan(range_m) else range_m,
        variance=0.0,
    )


def _path(time_ns: int, stamps_ns: list[int], poses: list[list[float]]) -> Any:
    stamped = _type("geometry_msgs/msg/PoseStamped")
    return _type("nav_msgs/msg/Path")(
        header=_header(time_ns, MAP_FRAME),
        poses=[
            stamped(header=_header(t, MAP_FRAME), pose=_place(*pose)) for t, pose in zip(stamps_ns, poses, strict=False)
        ],
    )


def _markers(time_ns: int, poi: PointOfInterest) -> Any:
    """A ball and the number above it; a newer record of the same door replaces it."""
    number = f"{poi.number or '?'} {poi.room_type}".strip()
    markers = [_marker(time_ns, poi, "doors", 2, 0.0, ""), _marker(time_ns, poi, "numbers", 9, 0.4, number)]
    return _type("visualization_msgs/msg/MarkerArray")(markers=markers)


def _marker(time_ns: int, poi: PointOfInterest, namespace: str, kind: int, z_m: float, text: str) -> Any:
    nothing = _type("sensor_msgs/msg/CompressedImage")(header=_header(0, ""), format="", data=np.empty(0, np.uint8))
    return _type("visualization_msgs/msg/Marker")(
        header=_header(time_ns, MAP_FRAME),
        ns=namespace,
        id=poi.poi_id % 2**31,
        type=kind,
        action=0,
        pose=_place(poi.x_m, poi.y_m, z_m=z_m),
        scale=_Vector(x=0.3, y=0.3, z=0.3),
        color=_type("std_msgs/msg/ColorRGBA")(r=0.8, g=0.2, b=0.2, a=1.0),
        lifetime=_type("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=nothing,
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=_type("visualization_msgs/msg/MeshFile")(filename="", data=np.empty(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def _photo(time_ns: int, jpeg: bytes) -> Any:
    data = np.frombuffer(jpeg, np.uint8)
    return _type("sensor_msgs/msg/CompressedImage")(header=_header(time_ns, "camera"), format="jpeg", data=data)


def _log_line(time_ns: int, module: str, level: str, text: str) -> Any:
    return _type("rcl_interfaces/msg/Log")(
        stamp=_stamp(time_ns), level=_LEVELS.get(level, 20), name=module, msg=text, file="", function="", line=0
    )


def _grid(image: OccupancyImage, time_ns: int) -> Any:
    """-1 unknown, 0 free, 100 wall; row 0 at the lowest y."""
    cells = np.full(image.cells.shape, -1, np.int8)
    cells[image.cells == FREE], cells[image.cells == OCCUPIED] = 0, 100
    rows, columns = image.cells.shape
    return _type("nav_msgs/msg/OccupancyGrid")(
        header=_header(time_ns, MAP_FRAME),
        info=_type("nav_msgs/msg/MapMetaData")(
            map_load_time=_stamp(time_ns),
            resolution=CELL_M,
            width=columns,
            height=rows,
            origin=_place(image.origin_x_m, image.origin_y_m),
        ),
        data=np.ascontiguousarray(cells[::-1]).ravel(),
    )
