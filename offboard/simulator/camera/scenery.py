"""Floor -> MJCF elements that only the camera sees: doors in frames, number plates, posters, floor and ceiling."""

from __future__ import annotations

import io
from math import atan, cos, degrees, radians, sin, tan

from PIL import Image

from common.constants import CAMERA_FIELD_OF_VIEW_RAD
from common.json_reader import Colour
from offboard.simulator.building.floor import Door, Floor, Poster
from offboard.simulator.camera.sign_textures import draw_plate, draw_poster, with_glare
from offboard.simulator.error_profiles import random_stream
from offboard.simulator.physics.mujoco_model import WALL_HEIGHT_M, Scenery
from onboard.poi.camera.frame import FULL_SIZE_PX

_DOOR_DEPTH_M = 0.02
_FRAME_WIDTH_M, _FRAME_DEPTH_M = 0.06, 0.03
_SIGN_DEPTH_M = 0.004
_TILT_MAX_RAD = radians(8.0)
_GLARE_SHARE = 0.3
_UNSEEN = 'contype="0" conaffinity="0"'


def build_scenery(floor: Floor, mode: str, seed: int) -> Scenery:
    """Everything the camera sees besides the walls; `mode` "hard" tilts plates and puts glare on some."""
    builder = _Builder()
    rng = random_stream(seed, "plates")
    builder.ground(floor)
    doors: list[tuple[Door, str]] = []
    for i, door in enumerate(floor.doors):
        picture = draw_plate(door.plate, door.number, door.room_type)
        tilt_rad = rng.uniform(-_TILT_MAX_RAD, _TILT_MAX_RAD) if mode == "hard" else 0.0
        if mode == "hard" and rng.random() < _GLARE_SHARE:
            picture = with_glare(picture, rng)
        plate_xml = builder.plate(f"plate{i}", door, picture, tilt_rad)
        builder.geoms.append(_frame_xml(door))
        doors.append((door, _leaf_xml(door) + (plate_xml if door.plate.on_door else "")))
        if not door.plate.on_door:
            builder.geoms.append(plate_xml)
    for i, poster in enumerate(floor.posters):
        builder.geoms.append(builder.poster(f"poster{i}", poster, draw_poster(poster, rng)))
    field_of_view_y_rad = 2.0 * atan(tan(CAMERA_FIELD_OF_VIEW_RAD / 2) * FULL_SIZE_PX[1] / FULL_SIZE_PX[0])
    assets, geoms = "".join(builder.assets), "".join(builder.geoms)
    return Scenery(assets, geoms, tuple(doors), builder.files, *FULL_SIZE_PX, degrees(field_of_view_y_rad))


class _Builder:
    def __init__(self) -> None:
        self.assets: list[str] = []
        self.geoms: list[str] = []
        self.files: dict[str, bytes] = {}

    def ground(self, floor: Floor) -> None:
        xs, ys = zip(*floor.exterior, strict=True)
        x_m, y_m = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
        half_x_m, half_y_m = (max(xs) - min(xs)) / 2 + 20.0, (max(ys) - min(ys)) / 2 + 20.0
        for z_m, rgba in ((-0.05, "0.45 0.44 0.42 1"), (WALL_HEIGHT_M + 0.05, "0.93 0.93 0.92 1")):
            self.geoms.append(
                f'<geom type="box" pos="{x_m:.3f} {y_m:.3f} {z_m}" size="{half_x_m:.3f} {half_y_m:.3f} 0.05" '
                f'rgba="{rgba}" {_UNSEEN}/>\n'
            )

    def plate(self, name: str, door: Door, picture: Image.Image, tilt_rad: float) -> str:
        plate = door.plate
        in_front_m = _DOOR_DEPTH_M if plate.on_door else 0.0
        place = (plate.x_m, plate.y_m, plate.centre_height_m, door.normal_rad)
        return self._sign(name, place, (plate.width_m, plate.height_m, in_front_m + _SIGN_DEPTH_M), picture, tilt_rad)

    def poster(self, name: str, poster: Poster, picture: Image.Image) -> str:
        place = (poster.x_m, poster.y_m, poster.centre_height_m, poster.normal_rad)
        return self._sign(name, place, (poster.width_m, poster.height_m, _SIGN_DEPTH_M), picture, 0.0)

    def _sign(
        self,
        name: str,
        place: tuple[float, float, float, float],
        size_m: tuple[float, float, float],
        picture: Image.Image,
        tilt_rad: float,
    ) -> str:
        buffer = io.BytesIO()
        picture.save(buffer, "PNG", compress_level=1)
        self.files[f"{name}.png"] = buffer.getvalue()
        self.assets.append(
            f'<texture name="{name}" type="2d" file="{name}.png"/>'
            f'<material name="{name}" texture="{name}" texuniform="false" texrepeat="1 1"/>\n'
        )
        return _board(place, size_m, tilt_rad, f'material="{name}"')


def _frame_xml(door: Door) -> str:
    """Posts and lintel, which stay where the door stands open."""
    frame = _darker(door.colour_rgb)
    across_m = door.width_m / 2 + _FRAME_WIDTH_M / 2
    lintel_m = door.height_m + _FRAME_WIDTH_M / 2
    post_m = (_FRAME_WIDTH_M, door.height_m, _FRAME_DEPTH_M)
    return (
        _panel_xml(door, -across_m, door.height_m / 2, post_m, frame)
        + _panel_xml(door, across_m, door.height_m / 2, post_m, frame)
        + _panel_xml(door, 0.0, lintel_m, (door.width_m + 2 * _FRAME_WIDTH_M, _FRAME_WIDTH_M, _FRAME_DEPTH_M), frame)
    )


def _leaf_xml(door: Door) -> str:
    """Leaf and handle."""
    return _panel_xml(
        door, 0.0, door.height_m / 2, (door.width_m, door.height_m, _DOOR_DEPTH_M), door.colour_rgb
    ) + _panel_xml(door, 0.4 * door.width_m, 1.05, (0.12, 0.02, _DOOR_DEPTH_M + 0.03), (150, 150, 150))


def _panel_xml(door: Door, right_m: float, z_m: float, size_m: tuple[float, float, float], rgb: Colour) -> str:
    """A plain board on the wall, `right_m` to the right of the door's middle as one looks at it."""
    place = (door.x_m - right_m * sin(door.normal_rad), door.y_m + right_m * cos(door.normal_rad), z_m, door.normal_rad)
    rgba = " ".join(f"{c / 255:.3f}" for c in rgb)
    return _board(place, size_m, 0.0, f'rgba="{rgba} 1"')


def _board(
    place: tuple[float, float, float, float], size_m: tuple[float, float, float], tilt_rad: float, look: str
) -> str:
    """A box on a wall: its own x to the right of who looks at it, its own y up, its own z out of the wall.

    `place` x_m, y_m, z_m, normal_rad; the texture of a MuJoCo box reads correctly on its +z face.
    """
    x_m, y_m, z_m, normal_rad = place
    width_m, height_m, depth_m = size_m
    c, s = cos(tilt_rad), sin(tilt_rad)
    right_x, right_y = -sin(normal_rad), cos(normal_rad)
    axes = f"{c * right_x:.7f} {c * right_y:.7f} {s:.7f} {-s * right_x:.7f} {-s * right_y:.7f} {c:.7f}"
    return (
        f'<geom type="box" pos="{x_m:.5f} {y_m:.5f} {z_m:.5f}" xyaxes="{axes}" '
        f'size="{width_m / 2:.5f} {height_m / 2:.5f} {depth_m:.5f}" {look} {_UNSEEN}/>\n'
    )


def _darker(rgb: Colour) -> Colour:
    return rgb[0] * 6 // 10, rgb[1] * 6 // 10, rgb[2] * 6 // 10
