"""Floor -> MuJoCo model: walls that stop the robot, the robot on two slides and a hinge, people that it can hit.

Doors, plates and posters, which only the camera sees, come from `camera/scenery.py` as MJCF elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, cos, hypot, sin
from typing import Any

import mujoco

from common.constants import CAMERA_HEIGHT_M, FOOTPRINT_RADIUS_M
from common.geometry import FloatArray
from common.json_reader import Colour
from offboard.simulator.building.floor import Door

WALL_HEIGHT_M = 2.5
CAMERA_NAME = "right"
_WALL_THICKNESS_M = 0.02
_HIDDEN_GROUP = 3  # MuJoCo draws the groups 0 to 2

# Velocity servos that pull the body to the speed of its wheels, weak enough that a wall wins. One explicit step takes
# gain * step / inertia of the difference: 0.56 for the slides (6 kg), 0.72 for the hinge (0.116 kg m2). Below 1 the
# body never swings over, whatever the limit of the force clips; above 2 a braked body would turn to and fro for ever
_KV_DRIVE, _FORCE_MAX_N = 667.0, 30.0
_KV_TURN, _TORQUE_MAX_N_M = 16.7, 4.0


@dataclass(frozen=True, slots=True)
class Scenery:
    """MJCF elements that only the camera sees, and the files that they name."""

    assets_xml: str = ""
    geoms_xml: str = ""
    doors_xml: tuple[tuple[Door, str], ...] = ()  # each left out while it stands open
    files: dict[str, bytes] = field(default_factory=dict)
    width_px: int = 0  # of the largest picture to be rendered
    height_px: int = 0
    field_of_view_y_deg: float = 40.0


def build_model(
    segments: FloatArray,
    wall_colour_rgb: Colour,
    people: Sequence[tuple[str, float]],
    scenery: Scenery,
    open_doors: Sequence[Door],
    step_s: float,
) -> Any:
    """The MjModel of a floor, stepped `step_s` at a time.

    `segments` (N, 4) in metres, each with the free space on its left; `people`: name and radius_m of each;
    `open_doors` are left out. The joints x, y, heading of the robot are its pose in the floor's frame.
    """
    walls = "".join(_wall_xml(segment) for segment in segments.tolist())
    persons = "".join(_person_xml(name, radius_m) for name, radius_m in people)
    closed_doors = "".join(xml for door, xml in scenery.doors_xml if door not in open_doors)
    red, green, blue = (c / 255.0 for c in wall_colour_rgb)
    xml = f"""
<mujoco model="floor">
  <compiler angle="radian"/>
  <option timestep="{step_s}" integrator="Euler" cone="pyramidal" iterations="20">
    <flag gravity="disable" eulerdamp="disable"/>
  </option>
  <statistic extent="1"/>
  <visual>
    <global offwidth="{max(scenery.width_px, 16)}" offheight="{max(scenery.height_px, 16)}"/>
    <quality shadowsize="0" offsamples="0"/>
    <map znear="0.12" zfar="80"/>
    <headlight ambient="0.62 0.62 0.62" diffuse="0.36 0.36 0.36" specular="0 0 0"/>
  </visual>
  <asset>
    <material name="wall" rgba="{red:.3f} {green:.3f} {blue:.3f} 1"/>
    {scenery.assets_xml}
  </asset>
  <worldbody>
    {walls}
    {scenery.geoms_xml}
    {closed_doors}
    <body name="robot">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="heading" type="hinge" axis="0 0 1"/>
      <geom type="sphere" size="{FOOTPRINT_RADIUS_M}" pos="0 0 {FOOTPRINT_RADIUS_M}" mass="6" contype="0"
            conaffinity="1" condim="1" solref="0.012 1" solimp="0.95 0.99 0.001" group="{_HIDDEN_GROUP}"/>
      <camera name="{CAMERA_NAME}" pos="0 0 {CAMERA_HEIGHT_M}" xyaxes="-1 0 0 0 0 1"
              fovy="{scenery.field_of_view_y_deg:.6f}"/>
    </body>
    {persons}
  </worldbody>
  <actuator>
    <velocity joint="x" kv="{_KV_DRIVE}" forcerange="-{_FORCE_MAX_N} {_FORCE_MAX_N}"/>
    <velocity joint="y" kv="{_KV_DRIVE}" forcerange="-{_FORCE_MAX_N} {_FORCE_MAX_N}"/>
    <velocity joint="heading" kv="{_KV_TURN}" forcerange="-{_TORQUE_MAX_N_M} {_TORQUE_MAX_N_M}"/>
  </actuator>
</mujoco>"""
    return mujoco.MjModel.from_xml_string(xml, scenery.files)


def _wall_xml(segment: Sequence[float]) -> str:
    x0, y0, x1, y1 = segment
    length_m, angle_rad = hypot(x1 - x0, y1 - y0), atan2(y1 - y0, x1 - x0)
    half_m = _WALL_THICKNESS_M / 2
    # The face on the left, where the free space is, lies exactly on the segment
    x_m = (x0 + x1) / 2 + half_m * sin(angle_rad)
    y_m = (y0 + y1) / 2 - half_m * cos(angle_rad)
    return (
        f'<geom type="box" pos="{x_m:.5f} {y_m:.5f} {WALL_HEIGHT_M / 2}" euler="0 0 {angle_rad:.7f}" '
        f'size="{max(length_m / 2, 1e-4):.5f} {half_m} {WALL_HEIGHT_M / 2}" material="wall" '
        f'contype="1" conaffinity="0" condim="1" solref="0.012 1" solimp="0.95 0.99 0.001"/>\n'
    )


def _person_xml(name: str, radius_m: float) -> str:
    return (
        f'<body name="{name}" mocap="true" pos="0 0 -10">'
        f'<geom type="sphere" size="{radius_m}" pos="0 0 {FOOTPRINT_RADIUS_M}" contype="1" conaffinity="0" condim="1" '
        f'group="{_HIDDEN_GROUP}"/>'
        f'<geom type="capsule" fromto="0 0 {radius_m} 0 0 1.5" size="{radius_m}" rgba="0.25 0.3 0.45 1" contype="0" '
        f'conaffinity="0"/><geom type="sphere" size="0.12" pos="0 0 1.68" rgba="0.85 0.68 0.56 1" contype="0" '
        f'conaffinity="0"/></body>\n'
    )
