"""The map as GeoJSON with the tags of OpenStreetMap's Simple Indoor Tagging: map data and spaces -> text.

Without a known place on the Earth the coordinates are metres of the map, which an old `crs` member declares, since
readers take GeoJSON for degrees otherwise. Numbers of rooms are text: in `ref`, and in `name` with the room's type.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from math import cos, radians, sin, sqrt
from typing import Any

import numpy as np

from common.geometry import Points
from common.zones import Zone, ZoneKind
from offboard.export.halls import Space
from offboard.export.tables import space_name
from offboard.export.title import TitleBlock
from offboard.export.wall_lines import wall_lines
from offboard.export.zone_lines import outline
from offboard.runs.run_folder import MapData

_EARTH_RADIUS_M, _EARTH_ECCENTRICITY_2 = 6_378_137.0, 6.694379990141e-3  # WGS 84
_LOCAL_METRES = 'LOCAL_CS["metres from the start of the robot",UNIT["metre",1.0],AXIS["x",EAST],AXIS["y",NORTH]]'
_Coordinates = list[Any]


def as_geojson(data: MapData, spaces: Sequence[Space], block: TitleBlock) -> bytes:
    place = _placing(block)
    level = {"level": block.level}
    features = [_space(space, place, level) for space in spaces]
    for mark, tags in ((0, {"indoor": "wall"}), (1, {"indoor": "wall", "source": "inferred"})):
        lines = [line for line in wall_lines(data.points_m[data.inferred == mark]) if (line[0] != line[-1]).any()]
        features += [_feature("LineString", place(line), tags | level) for line in lines]
    features += [_door(poi, place, level) for poi in data.pois]
    features += [_zone(zone, place, level) for zone in data.zones]
    content: dict[str, Any] = {"type": "FeatureCollection", "name": block.title}
    if block.anchor_deg is None:
        content["crs"] = {"type": "name", "properties": {"name": _LOCAL_METRES}}
    return json.dumps(content | {"features": features}, ensure_ascii=False, allow_nan=False).encode() + b"\n"


def _placing(block: TitleBlock) -> Callable[[Points], _Coordinates]:
    """Places (N, 2) of the map -> coordinates: longitude and latitude where the start's place is known, else metres."""
    if block.anchor_deg is None or block.bearing_rad is None:
        return lambda points_m: [[round(x, 3), round(y, 3)] for x, y in points_m.tolist()]
    latitude_rad, longitude_rad = (radians(angle) for angle in block.anchor_deg)
    bearing_rad = block.bearing_rad
    curve = 1.0 - _EARTH_ECCENTRICITY_2 * sin(latitude_rad) ** 2
    north_radius_m = _EARTH_RADIUS_M * (1.0 - _EARTH_ECCENTRICITY_2) / curve**1.5
    east_radius_m = _EARTH_RADIUS_M / sqrt(curve) * cos(latitude_rad)

    def degrees_of(points_m: Points) -> _Coordinates:
        coordinates = []
        for x, y in points_m.tolist():
            east_m = x * sin(bearing_rad) - y * cos(bearing_rad)
            north_m = x * cos(bearing_rad) + y * sin(bearing_rad)
            longitude = longitude_rad + east_m / east_radius_m
            latitude = latitude_rad + north_m / north_radius_m
            coordinates.append([round(longitude / radians(1.0), 9), round(latitude / radians(1.0), 9)])
        return coordinates

    return degrees_of


def _feature(kind: str, coordinates: _Coordinates, tags: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "properties": tags, "geometry": {"type": kind, "coordinates": coordinates}}


def _space(space: Space, place: Callable[[Points], _Coordinates], level: dict[str, str]) -> dict[str, Any]:
    ring = place(space.outline)
    kind = "corridor" if space.kind == "hall" else "area"
    tags = {"indoor": kind, "name": space_name(space).capitalize(), "area_m2": round(space.area_m2, 2)}
    return _feature("Polygon", [[*ring, ring[0]]], tags | level)


def _zone(zone: Zone, place: Callable[[Points], _Coordinates], level: dict[str, str]) -> dict[str, Any]:
    """No tag of OpenStreetMap fits: it is the robot that must not enter."""
    line = outline(zone)
    counter_clockwise = float(np.sum(line[:-1, 0] * line[1:, 1] - line[1:, 0] * line[:-1, 1])) >= 0.0
    coordinates = place(line if counter_clockwise else line[::-1])
    tags = {"robot": zone.kind.value, "name": zone.title} | level
    if zone.kind is ZoneKind.LINE:
        return _feature("LineString", coordinates, tags)
    return _feature("Polygon", [coordinates], tags)


def _door(poi: dict[str, Any], place: Callable[[Points], _Coordinates], level: dict[str, str]) -> dict[str, Any]:
    (at,) = place(np.array([[poi["x_m"], poi["y_m"]]], dtype=np.float64))
    number, room_type = str(poi.get("number") or ""), str(poi.get("room_type") or "")
    name = str(poi.get("room_name") or "") or f"{room_type or 'Room'} {number or '?'}"
    tags = {"door": "yes", "ref": number, "name": name}
    tags |= {"room": room_type.lower().replace(" ", "_")} if room_type else {}
    return _feature("Point", at, tags | level)
