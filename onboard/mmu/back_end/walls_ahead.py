"""Walls ahead: by how much they come nearer measures how far the wheels really drove.

Where walls stand at right angles, the range to one straight ahead measures the path towards it. The wall counts again
once the robot turned and drives along it.
"""

from __future__ import annotations

from math import cos, radians, sin, sqrt

import numpy as np

from common.geometry import FloatArray, Pose2, wrap_angle
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.odometry_noise import WHEEL_SCALE_SD
from onboard.mmu.back_end.wall_association import WallAssociation
from onboard.mmu.back_end.wall_landmarks import WallAhead, WallPiece

# The sensitivity to these was not measured
SQUARE_MAX_RAD = radians(8.0)  # a path that departs further from the walls' directions does not meet one squarely
RANGE_SD_M = 0.01
SIGMAS_MAX = 3.0  # what slip and scale of the wheels do not explain was no square wall
KEPT_PATH_M = 15.0  # by then it is driven along, or it was another one
BESIDE_M = 1.0  # from where it was observed ahead to where it is driven along


class WallsAhead:
    """`observe` takes in walls that came nearer; `meet` associates them with pieces of walls beside the path."""

    def __init__(self, keyframes: KeyframeGraph, walls: WallAssociation) -> None:
        self._keyframes = keyframes
        self._walls = walls
        self._scale_information = WHEEL_SCALE_SD**-2  # of the scale error of the wheels
        self._ahead: list[WallAhead] = []  # observed lately, not met yet

    def observe(self, ranges_to_wall: FloatArray) -> None:
        """Rows (N, 8) of an `Increment`.

        Only where walls stand at right angles: otherwise a normal is known to a few degrees only, and a wall at
        5 degrees comes nearer by 0.4 % less.
        """
        if not self._walls.square:
            return
        graph = self._keyframes.graph
        for far, far_x_m, far_y_m, near, near_x_m, near_y_m, closer_m, left_m in ranges_to_wall.tolist():
            first, second = graph.pose(int(far)), graph.pose(int(near))
            off_rad = self._walls.off_right_angles_rad(second.heading_rad)
            if far == near or abs(off_rad) > SQUARE_MAX_RAD:
                continue
            normal_rad = second.heading_rad - off_rad
            normal = np.array([cos(normal_rad), sin(normal_rad)])
            driven = second.transform([near_x_m, near_y_m]) - first.transform([far_x_m, far_y_m])
            if self._add_factor(int(far), int(near), normal, float(driven @ normal), closer_m):
                ahead_rad = wrap_angle(normal_rad - first.heading_rad)
                range_m = closer_m + left_m
                self._ahead.append(WallAhead(int(far), self._keyframes.path_m, far_x_m, far_y_m, ahead_rad, range_m))

    def meet(self, piece: WallPiece) -> None:
        """A wall that was ahead may be driven along now: then the path towards it is known past the turn."""
        graph = self._keyframes.graph
        pose = graph.pose(piece.node)
        line = piece.in_map(pose)
        normal = np.array([cos(line.normal_rad), sin(line.normal_rad)])
        here = np.array([pose.x_m, pose.y_m])
        for ahead in self._ahead:
            observed_from = graph.pose(ahead.node)
            start = observed_from.transform([ahead.x_m, ahead.y_m])
            beside_m = abs(float((line.middle - start) @ np.array([-normal[1], normal[0]])))
            turned_rad = wrap_angle(observed_from.heading_rad + ahead.normal_rad - line.normal_rad)
            if ahead.node >= piece.node or abs(turned_rad) > SQUARE_MAX_RAD or beside_m > piece.length_m / 2 + BESIDE_M:
                continue
            closer_m = ahead.range_m - float((line.middle - here) @ normal)
            if self._add_factor(ahead.node, piece.node, normal, float((here - start) @ normal), closer_m):
                self._ahead.remove(ahead)
                return

    def forget_old(self) -> None:
        """Drops the walls that were ahead too long ago."""
        oldest_m = self._keyframes.path_m - KEPT_PATH_M
        self._ahead = [ahead for ahead in self._ahead if ahead.path_m > oldest_m]

    def _add_factor(self, far: int, near: int, normal: FloatArray, path_m: float, closer_m: float) -> bool:
        """A wall with that normal (2,) came nearer by `closer_m`, in the map by `path_m`; true if plausible."""
        keyframes = self._keyframes
        slip = keyframes.noise.slip(keyframes[len(keyframes) - 1].slip_m_per_sqrt_m)
        variance_m2 = RANGE_SD_M**2 + slip**2 * abs(path_m)
        sd_m = sqrt(variance_m2 + path_m**2 / self._scale_information)
        if abs(closer_m - path_m) > SIGMAS_MAX * sd_m:
            return False
        self._scale_information += path_m**2 / variance_m2
        first, second = keyframes.graph.pose(far), keyframes.graph.pose(near)
        between_m = float(np.array([second.x_m - first.x_m, second.y_m - first.y_m]) @ normal)
        in_first = Pose2(0.0, 0.0, -first.heading_rad).transform(normal)
        keyframes.graph.ranges_to_wall.add(far, near, in_first, between_m + closer_m - path_m, RANGE_SD_M)
        return True
