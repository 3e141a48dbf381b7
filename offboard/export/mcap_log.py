"""The whole run as MCAP: every recorded message, for log players such as Foxglove and Lichtblick.

What they can show has a schema of theirs (poses, walls, sonars, doors, photos, log); every other topic is JSON under
its own name. A run that was cut off by a crash has its messages in `run.sqlite` up to then, and is exported like any
other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import cos, inf, sin
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from common.constants import SONAR_BEARINGS_RAD, SONAR_MAX_M
from common.messages.points_of_interest import PointOfInterest
from common.messages.topics import LOG, MAP, POI, POSE, RANGES, TRAJECTORY, Topic
from offboard.export.json_schema import as_json, schema_of
from offboard.export.occupancy_image import CELL_M, OccupancyImage, image_of_run
from offboard.export.run_time import NS, RunTime
from offboard.runs.map_assembly import MapAssembly
from offboard.runs.run_database import Message, RunReader

WALLS_PERIOD_NS = 5 * NS  # the whole map each time
MAP_FRAME, ROBOT_FRAME = "map", "robot"
_LEVELS = {"DEBUG": Log.DEBUG, "INFO": Log.INFO, "WARNING": Log.WARNING, "ERROR": Log.ERROR, "CRITICAL": Log.FATAL}
_ROOM_M = 0.3  # size of the mark of a door

Shown = tuple[str, Any]  # channel, message of a Foxglove schema


def write_mcap(run_dir: Path, file: BinaryIO) -> None:
    with RunReader(run_dir) as run:
        time, log = RunTime(run), _Log(file)
        views = _Views()
        now_ns = 0
        for message in run.display_data():
            now_ns = max(now_ns, time.of(message))
            if message.topic not in _UNSEEN:
                log.add_json(message.topic, time.of(message), message)
            for channel, shown in views.of(message, time):
                log.add_protobuf(channel, time.of(message), shown)
        log.add_protobuf("/map", now_ns, _grid(image_of_run(run_dir), now_ns))
        log.finish()


class _Log:
    """Channels and schemas are written as they are first needed."""

    def __init__(self, file: BinaryIO) -> None:
        self._writer = Writer(file)
        self._writer.start(profile="", library="indoor-mapping")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}

    def add_protobuf(self, name: str, time_ns: int, message: Any) -> None:
        def schema() -> tuple[str, str, bytes]:
            descriptors = build_file_descriptor_set(type(message)).SerializeToString()
            return message.DESCRIPTOR.full_name, SchemaEncoding.Protobuf, descriptors

        self._add(name, time_ns, message.SerializeToString(), MessageEncoding.Protobuf, schema)

    def add_json(self, topic: Topic[Any], time_ns: int, message: Message[Any]) -> None:
        def schema() -> tuple[str, str, bytes]:
            return f"indoor_mapping.{topic.payload.__name__}", SchemaEncoding.JSONSchema, schema_of(topic.payload)

        self._add(f"/{topic.key}", time_ns, as_json(message.payload), MessageEncoding.JSON, schema)

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _add(
        self, name: str, time_ns: int, data: bytes, encoding: str, schema: Callable[[], tuple[str, str, bytes]]
    ) -> None:
        if name not in self._channels:
            schema_name, schema_encoding, definition = schema()
            if schema_name not in self._schemas:
                self._schemas[schema_name] = self._writer.register_schema(schema_name, schema_encoding, definition)
            self._channels[name] = self._writer.register_channel(name, encoding, self._schemas[schema_name])
        self._counts[name] = self._counts.get(name, 0) + 1
        self._writer.add_message(self._channels[name], time_ns, data, time_ns, self._counts[name])


_UNSEEN = (MAP, TRAJECTORY, POI, *LOG.values())  # these have a schema of the players alone


class _Views:
    """What the players show of a message."""

    def __init__(self) -> None:
        self._map = MapAssembly()
        self._walls_due_ns = -inf

    def of(self, message: Message[Any], time: RunTime) -> Iterator[Shown]:
        payload, now_ns = message.payload, time.of(message)
        if message.topic is POSE:
            pose = payload.x_m, payload.y_m, payload.heading_rad
            yield "/tf", _transform(now_ns, *pose)
            yield "/pose", _pose_in_frame(now_ns, *pose)
        elif message.topic is RANGES:
            yield "/sonars", _scan(now_ns, payload.range_m)
        elif message.topic is MAP:
            self._map.add(payload)
            if now_ns >= self._walls_due_ns or payload.start == 0:
                self._walls_due_ns = now_ns + WALLS_PERIOD_NS
                yield "/walls", _walls(now_ns, *self._map.known())
        elif message.topic is TRAJECTORY:
            yield "/path", _path(now_ns, np.asarray(payload.poses).reshape(-1, 3))
        elif message.topic is POI:
            yield "/doors", _door(now_ns, payload)
            if payload.photo_jpeg:
                yield "/photos", _photo(now_ns, payload.photo_jpeg)
        elif message.topic in _LOGS:
            yield "/log", _log_line(now_ns, message.topic.producer, payload.level, payload.text)


_LOGS = tuple(LOG.values())


def _stamped(message: Any, time_ns: int, frame: str = MAP_FRAME) -> Any:
    message.timestamp.FromNanoseconds(time_ns)
    message.frame_id = frame
    return message


def _place(pose: Any, x_m: float, y_m: float, heading_rad: float = 0.0) -> None:
    pose.position.x, pose.position.y = x_m, y_m
    _turn(pose.orientation, heading_rad)


def _turn(rotation: Any, heading_rad: float) -> None:
    rotation.z, rotation.w = sin(heading_rad / 2), cos(heading_rad / 2)


def _transform(time_ns: int, x_m: float, y_m: float, heading_rad: float) -> Any:
    transform = FrameTransform(parent_frame_id=MAP_FRAME, child_frame_id=ROBOT_FRAME)
    transform.timestamp.FromNanoseconds(time_ns)
    transform.translation.x, transform.translation.y = x_m, y_m
    _turn(transform.rotation, heading_rad)
    return transform


def _pose_in_frame(time_ns: int, x_m: float, y_m: float, heading_rad: float) -> Any:
    message = _stamped(PoseInFrame(), time_ns)
    _place(message.pose, x_m, y_m, heading_rad)
    return message


def _scan(time_ns: int, ranges_m: tuple[float, ...]) -> Any:
    """The five sonars from the right to the left; NaN where nothing answered."""
    message = _stamped(LaserScan(), time_ns, ROBOT_FRAME)
    _turn(message.pose.orientation, 0.0)
    message.start_angle, message.end_angle = SONAR_BEARINGS_RAD[-1], SONAR_BEARINGS_RAD[0]
    message.ranges.extend(range_m if range_m <= SONAR_MAX_M else float("nan") for range_m in reversed(ranges_m))
    return message


def _walls(time_ns: int, points_m: np.ndarray[Any, Any], inferred: np.ndarray[Any, Any]) -> Any:
    """x, y, z and `inferred` as 32-bit floats."""
    message = _stamped(PointCloud(), time_ns)
    _turn(message.pose.orientation, 0.0)
    table = np.column_stack([points_m, np.zeros(len(points_m)), inferred]).astype("<f4")
    message.point_stride = 16
    for k, name in enumerate(("x", "y", "z", "inferred")):
        message.fields.add(name=name, offset=4 * k, type=PackedElementField.FLOAT32)
    message.data = table.tobytes()
    return message


def _path(time_ns: int, poses: np.ndarray[Any, Any]) -> Any:
    message = _stamped(PosesInFrame(), time_ns)
    for x_m, y_m, heading_rad in poses.tolist():
        _place(message.poses.add(), x_m, y_m, heading_rad)
    return message


def _door(time_ns: int, poi: PointOfInterest) -> Any:
    """A sphere and the number; a newer record of the same door replaces it."""
    scene = SceneUpdate()
    entity = scene.entities.add(id=f"door {poi.poi_id}")
    _stamped(entity, time_ns)
    sphere = entity.spheres.add()
    _place(sphere.pose, poi.x_m, poi.y_m)
    sphere.size.x = sphere.size.y = sphere.size.z = _ROOM_M
    text = entity.texts.add(text=f"{poi.number or '?'} {poi.room_type}".strip(), billboard=True, font_size=0.4)
    _place(text.pose, poi.x_m, poi.y_m)
    text.pose.position.z = _ROOM_M
    for part in (sphere, text):
        part.color.r, part.color.a = 0.8, 1.0
    for key in ("number", "room_type", "name", "state"):
        entity.metadata.add(key=key, value=getattr(poi, key))
    return scene


def _photo(time_ns: int, jpeg: bytes) -> Any:
    message = _stamped(CompressedImage(format="jpeg"), time_ns, "camera")
    message.data = jpeg
    return message


def _log_line(time_ns: int, module: str, level: str, text: str) -> Any:
    message = Log(level=_LEVELS.get(level, Log.UNKNOWN), message=text, name=module)
    message.timestamp.FromNanoseconds(time_ns)
    return message


def _grid(image: OccupancyImage, time_ns: int) -> Any:
    """Row 0 at the lowest y, a byte per cell: 0 wall, 205 unknown, 254 free, as in the occupancy image."""
    message = _stamped(Grid(), time_ns)
    _place(message.pose, image.origin_x_m, image.origin_y_m)
    columns = image.cells.shape[1]
    message.column_count, message.row_stride, message.cell_stride = columns, columns, 1
    message.cell_size.x = message.cell_size.y = CELL_M
    message.fields.add(name="occupancy", offset=0, type=PackedElementField.UINT8)
    message.data = np.ascontiguousarray(image.cells[::-1]).tobytes()
    return message
