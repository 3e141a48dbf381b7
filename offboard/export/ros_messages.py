"""Values of ours -> messages of ROS 2, in ROS's own types and frames (REP 103, 105, 117), for bag and process `ros`.

`map` is the map's frame, `base_link` the robot, `sonar_*` its sonars, whose ranges count from the robot's centre. Times
are nanoseconds since 1970. The types are rosbags', which knows them without an installation of ROS. Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import cos, inf, isnan, radians, sin
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_typestore

from common.constants import SONAR_BEARINGS_RAD, SONAR_MAX_M, SONAR_NAMES, SONAR_RANGE_MIN_M
from common.grid_cells import FREE, WALL
from common.messages.mapping import PoseEstimate
from common.messages.motion import Odometry, Ranges
from common.messages.points_of_interest import PointOfInterest
from offboard.export.run_time import NS

MAP_FRAME, ODOM_FRAME, ROBOT_FRAME = "map", "odom", "base_link"
SONAR_CONE_RAD = radians(45.0)  # where the sensor's data sheet sees a person
LATCHED = ("/map", "/tf_static", "/path", "/doors")  # who subscribes late gets the newest
STORE = get_typestore(Stores.ROS2_JAZZY)
_LEVELS = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "CRITICAL": 50}  # rcl_interfaces/Log
_POI_IDS = 2**31  # a marker's id is signed

Sent = tuple[str, Any]  # topic and message
Place = tuple[float, float, float]  # x, y, heading


def type_of(message: Any) -> str:
    """Its name, for example `nav_msgs/msg/Path`."""
    name: str = message.__msgtype__
    return name


def serialized(message: Any) -> bytes:
    """As it travels between programs of ROS, and stands in a bag (CDR)."""
    return bytes(STORE.serialize_cdr(message, type_of(message)))


def _type(name: str) -> Callable[..., Any]:
    return STORE.types[name]


_Time, _Header = _type("builtin_interfaces/msg/Time"), _type("std_msgs/msg/Header")
_Point, _Vector, _Quaternion = (_type(f"geometry_msgs/msg/{name}") for name in ("Point", "Vector3", "Quaternion"))
_Pose = _type("geometry_msgs/msg/Pose")


def _stamp(time_ns: int) -> Any:
    return _Time(sec=time_ns // NS, nanosec=time_ns % NS)


def _header(time_ns: int, frame: str) -> Any:
    return _Header(stamp=_stamp(time_ns), frame_id=frame)


def _rotation(heading_rad: float) -> Any:
    return _Quaternion(x=0.0, y=0.0, z=sin(heading_rad / 2), w=cos(heading_rad / 2))


def _place(x_m: float, y_m: float, heading_rad: float = 0.0, z_m: float = 0.0) -> Any:
    return _Pose(position=_Point(x=x_m, y=y_m, z=z_m), orientation=_rotation(heading_rad))


def _transforms(time_ns: int, parent: str, children: Mapping[str, Place]) -> Any:
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


def of_sonar_frames(time_ns: int) -> Sent:
    frames = {f"sonar_{name}": (0.0, 0.0, b) for name, b in zip(SONAR_NAMES, SONAR_BEARINGS_RAD, strict=True)}
    return "/tf_static", _transforms(time_ns, ROBOT_FRAME, frames)


def _covariance(pose: PoseEstimate) -> Any:
    """6 x 6, row by row: x, y, z, and the rotations about them."""
    covariance = np.zeros((6, 6))
    xx, xy, yy = pose.covariance
    covariance[:2, :2] = [[xx, xy], [xy, yy]]
    covariance[5, 5] = pose.sd_heading_rad**2
    return covariance.ravel()


def of_pose(time_ns: int, pose: PoseEstimate) -> tuple[Sent, Sent]:
    place = pose.x_m, pose.y_m, pose.heading_rad
    with_covariance = _type("geometry_msgs/msg/PoseWithCovariance")(pose=_place(*place), covariance=_covariance(pose))
    stamped = _type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=_header(time_ns, MAP_FRAME), pose=with_covariance
    )
    return ("/tf", _transforms(time_ns, MAP_FRAME, {ROBOT_FRAME: place})), ("/pose", stamped)


def of_odometry(time_ns: int, odometry: Odometry) -> Sent:
    twist = _type("geometry_msgs/msg/Twist")(
        linear=_Vector(x=odometry.speed_m_s, y=0.0, z=0.0), angular=_Vector(x=0.0, y=0.0, z=odometry.yaw_rate_rad_s)
    )
    return "/odom", _type("nav_msgs/msg/Odometry")(
        header=_header(time_ns, ODOM_FRAME),
        child_frame_id=ROBOT_FRAME,
        pose=_type("geometry_msgs/msg/PoseWithCovariance")(
            pose=_place(odometry.x_m, odometry.y_m, odometry.yaw_rad), covariance=np.zeros(36)
        ),
        twist=_type("geometry_msgs/msg/TwistWithCovariance")(twist=twist, covariance=np.zeros(36)),
    )


def of_ranges(time_ns: int, ranges: Ranges) -> list[Sent]:
    """One message per sonar; infinite where nothing answered (REP 117)."""
    return [
        (
            f"/range/{name}",
            _type("sensor_msgs/msg/Range")(
                header=_header(time_ns, f"sonar_{name}"),
                radiation_type=0,
                field_of_view=SONAR_CONE_RAD,
                min_range=SONAR_RANGE_MIN_M,
                max_range=SONAR_MAX_M,
                range=inf if isnan(range_m) else range_m,
                variance=0.0,
            ),
        )
        for name, range_m in zip(SONAR_NAMES, ranges.range_m, strict=False)
    ]


def of_path(time_ns: int, stamps_ns: Sequence[int], poses: Sequence[Sequence[float]]) -> Sent:
    """Poses as x, y, heading."""
    stamped = _type("geometry_msgs/msg/PoseStamped")
    return "/path", _type("nav_msgs/msg/Path")(
        header=_header(time_ns, MAP_FRAME),
        poses=[
            stamped(header=_header(t, MAP_FRAME), pose=_place(*pose)) for t, pose in zip(stamps_ns, poses, strict=False)
        ],
    )


def of_doors(time_ns: int, pois: Sequence[PointOfInterest]) -> Sent:
    """A ball and the number above it for each; a newer record of the same door replaces it."""
    markers = [marker for poi in pois for marker in _markers(time_ns, poi)]
    return "/doors", _type("visualization_msgs/msg/MarkerArray")(markers=markers)


def _markers(time_ns: int, poi: PointOfInterest) -> list[Any]:
    number = f"{poi.number or '?'} {poi.room_type}".strip()
    return [_marker(time_ns, poi, "doors", 2, 0.0, ""), _marker(time_ns, poi, "numbers", 9, 0.4, number)]


def _marker(time_ns: int, poi: PointOfInterest, namespace: str, kind: int, z_m: float, text: str) -> Any:
    nothing = _type("sensor_msgs/msg/CompressedImage")(header=_header(0, ""), format="", data=np.empty(0, np.uint8))
    return _type("visualization_msgs/msg/Marker")(
        header=_header(time_ns, MAP_FRAME),
        ns=namespace,
        id=poi.poi_id % _POI_IDS,
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


def of_photo(time_ns: int, jpeg: bytes) -> Sent:
    data = np.frombuffer(jpeg, np.uint8)
    kind = _type("sensor_msgs/msg/CompressedImage")
    return "/photos/compressed", kind(header=_header(time_ns, "camera"), format="jpeg", data=data)


def of_log_line(time_ns: int, module: str, level: str, text: str) -> Sent:
    return "/rosout", _type("rcl_interfaces/msg/Log")(
        stamp=_stamp(time_ns), level=_LEVELS.get(level, 20), name=module, msg=text, file="", function="", line=0
    )


_OCCUPANCY = np.full(256, -1, np.int8)  # of a cell: -1 unknown, 0 free, 100 wall
_OCCUPANCY[FREE], _OCCUPANCY[WALL] = 0, 100


def of_map(time_ns: int, cells: npt.NDArray[np.uint8], origin_m: tuple[float, float], cell_m: float) -> Sent:
    """Cells (rows, columns) as `common/grid_cells.py` has them, row 0 at the lowest y, whose corner is the origin."""
    rows, columns = cells.shape
    return "/map", _type("nav_msgs/msg/OccupancyGrid")(
        header=_header(time_ns, MAP_FRAME),
        info=_type("nav_msgs/msg/MapMetaData")(
            map_load_time=_stamp(time_ns), resolution=cell_m, width=columns, height=rows, origin=_place(*origin_m)
        ),
        data=_OCCUPANCY[cells].ravel(),
    )
