"""The camera on its mast: level, looking to the robot's right; columns and rows of its picture <-> directions.

Pure geometry of a pinhole without distortion. A column fixes a bearing in the plane, and a row, once the distance of
the wall is known, a height.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, pi, tan

from common.constants import CAMERA_FIELD_OF_VIEW_RAD, CAMERA_HEIGHT_M

LOOKS_AT_RAD = -pi / 2  # in the robot's frame


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A picture size with its field of view. `depth_m` counts along the optical axis."""

    width_px: int
    height_px: int
    field_of_view_rad: float = CAMERA_FIELD_OF_VIEW_RAD

    @property
    def focal_px(self) -> float:
        return self.width_px / 2 / tan(self.field_of_view_rad / 2)

    def resized(self, width_px: int, height_px: int) -> CameraModel:
        """The same lens in another picture size."""
        return CameraModel(width_px, height_px, self.field_of_view_rad)

    def bearing_rad(self, u_px: float) -> float:
        """Direction of a column in the robot's frame; the picture's left is the robot's front."""
        return LOOKS_AT_RAD - atan((u_px - self.width_px / 2) / self.focal_px)

    def column_px(self, bearing_rad: float) -> float:
        """The inverse of `bearing_rad`."""
        return self.width_px / 2 - self.focal_px * tan(bearing_rad - LOOKS_AT_RAD)

    def height_m(self, v_px: float, depth_m: float) -> float:
        """Height above the floor of what is seen in a row."""
        return CAMERA_HEIGHT_M - (v_px - self.height_px / 2) / self.focal_px * depth_m

    def row_px(self, height_m: float, depth_m: float) -> float:
        """The inverse of `height_m`."""
        return self.height_px / 2 - (height_m - CAMERA_HEIGHT_M) / depth_m * self.focal_px

    def metres_per_px(self, depth_m: float) -> float:
        """Scale of a wall square to the axis."""
        return depth_m / self.focal_px
