"""Ties by straight walls: one that goes on, walls at right angles to each other, a wall ahead that comes nearer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import cos, pi, radians, sin, sqrt

import numpy as np

from common.geometry import FloatArray, Pose2, RightAngles, wrap_angle
from onboard.mmu.edges import Edge, Kind
from onboard.mmu.key_frames import in_map
from onboard.mmu.odometry_errors import LENGTH_SD
from onboard.mmu.pose_graph import WALLS
from onboard.mmu.trail import Trail, about
from onboard.mmu.walls import WallAhead, WallPiece, continuation, fit_piece

RIGHT_ANGLES_WALL_M = 20.0  # of wall, before anything is concluded
RIGHT_ANGLES_SHARE = 0.9
UPRIGHT_MAX_RAD = radians(6.0)
RIGHT_ANGLES_SD_RAD = radians(0.3)  # of one piece: it is known to 0.15
APPROACH_OFF_RAD = radians(8.0)  # a way that departs further from the walls' directions is no square approach
APPROACH_SD_M = 0.01
APPROACH_SIGMAS = 3.0  # what slip and length of the wheels do not explain was no square wall
AHEAD_WAY_M = 15.0  # by then it is driven along, or it was another one
AHEAD_BESIDE_M = 1.0  # from where it was seen ahead to where it is driven along
PIECE_WAY_M = 3.0
PIECE_GAP_M = 2.5
PIECE_LOOK_BACK_M = 45.0
PIECE_SD_RAD = radians(0.5)  # how far two pieces of one wall differ in direction
PIECE_END_SD_M = 0.01
SAME_WALL_RAD = radians(0.6)  # a piece that departs more says something of its own about right angles
PIECE_OFFSET_SD_M = 0.10


@dataclass(slots=True)
class WallTies:
    _trail: Trail
    _pieces: list[WallPiece] = field(default_factory=list)
    _right_angles: RightAngles = field(default_factory=RightAngles)  # weight: metres of wall
    _upright: int = 0  # key frame of the newest piece at a right angle
    _length_information: float = LENGTH_SD**-2  # of how much longer the way is than the wheels say
    _ahead: list[WallAhead] = field(default_factory=list)  # seen lately, not met yet

    def look_ahead(self, approaches: FloatArray) -> None:
        """Where walls stand at right angles, one straight ahead says how far the way towards it was.

        Without that its normal is known to a few degrees only, and a wall at 5 degrees comes nearer by 0.4 % less.
        """
        if not self._square:
            return
        for far, far_x_m, far_y_m, near, near_x_m, near_y_m, closer_m, left_m in approaches.tolist():
            first, second = self._trail.graph.pose(int(far)), self._trail.graph.pose(int(near))
            off_rad = self._off_right_angles(second.heading_rad)
            if far == near or abs(off_rad) > APPROACH_OFF_RAD:
                continue
            normal_rad = second.heading_rad - off_rad
            n = np.array([cos(normal_rad), sin(normal_rad)])
            driven = second.transform([near_x_m, near_y_m]) - first.transform([far_x_m, far_y_m])
            if self._come_nearer(int(far), int(near), second, n, float(driven @ n), closer_m):
                ahead_rad = wrap_angle(normal_rad - first.heading_rad)
                self._ahead.append(
                    WallAhead(int(far), self._trail.way_m, far_x_m, far_y_m, ahead_rad, closer_m + left_m)
                )

    def _come_nearer(self, far: int, near: int, pose: Pose2, n: FloatArray, way_m: float, closer_m: float) -> bool:
        """Tie two nodes: a wall came nearer by `closer_m` along `n` (2,), by the map `way_m`; true if believed."""
        slip = self._trail.errors.slip(self._trail.frames[-1].slip_m_per_sqrt_m)
        slip_m2 = APPROACH_SD_M**2 + slip**2 * abs(way_m)
        doubt_m = sqrt(slip_m2 + way_m**2 / self._length_information)
        if abs(closer_m - way_m) > APPROACH_SIGMAS * doubt_m:
            return False
        self._length_information += way_m**2 / slip_m2
        first = self._trail.graph.pose(far)
        missing = (closer_m - way_m) * n
        relative = first.between(Pose2(pose.x_m + missing[0], pose.y_m + missing[1], pose.heading_rad))
        information = _across(_turned_back(n, first), APPROACH_SD_M)
        self._trail.graph.edges.append(Edge(far, near, relative, information, Kind.APPROACH))
        return True

    def look_beside(self) -> None:
        """Straight pieces among the newest echoes on both sides."""
        rows = self._trail.echoes.stretch(self._trail.way_m - PIECE_WAY_M)
        if len(rows) == 0:
            return
        poses = self._trail.graph.poses
        node = len(self._trail.frames) - 1
        self._right_angles = RightAngles()
        for piece in self._pieces:
            direction_rad = float(poses[piece.node, 2]) + piece.normal_rad
            self._right_angles = self._right_angles.with_direction(direction_rad, piece.length_m)
        self._ahead = [ahead for ahead in self._ahead if ahead.way_m > self._trail.way_m - AHEAD_WAY_M]
        points, directions = in_map(rows, poses)
        pose = self._trail.graph.pose(node)
        side = np.sin(directions - pose.heading_rad)
        for sign in (1.0, -1.0):
            mine = side * sign > cos(radians(25.0))
            line = fit_piece(points[mine], directions[mine])
            if line is None:
                continue
            middle, normal_rad, length_m = line
            local = pose.inverse().transform(middle)
            turned_rad = wrap_angle(normal_rad - pose.heading_rad)
            piece = WallPiece(node, self._trail.way_m, float(local[0]), float(local[1]), turned_rad, length_m)
            self._continue_wall(piece, poses)
            self._meet(piece, poses)
            self._pieces.append(piece)
            self._keep_right_angles(piece)

    def _goes_on_with(self, piece: WallPiece, poses: FloatArray) -> Iterator[tuple[WallPiece, float, float]]:
        """Earlier pieces that may be of the same wall, the earliest first; by which angle and offset it departs."""
        middle, normal_rad = piece.in_map(Pose2.from_array(poses[piece.node]))
        for other in self._pieces:
            if 0.0 < piece.way_m - other.way_m <= PIECE_LOOK_BACK_M:
                other_middle, other_normal = other.in_map(Pose2.from_array(poses[other.node]))
                departs = continuation(middle, normal_rad, piece.length_m, other_middle, other_normal, other.length_m)
                if departs is not None:
                    yield other, *departs

    def _continue_wall(self, piece: WallPiece, poses: FloatArray) -> None:
        """Tie the piece to the earliest one of the same wall in the stretch looked back over."""
        pose = Pose2.from_array(poses[piece.node])
        middle, _ = piece.in_map(pose)
        for other, turn, offset in self._goes_on_with(piece, poses):
            if piece.way_m - other.way_m < PIECE_GAP_M:
                continue
            other_pose = Pose2.from_array(poses[other.node])
            _, other_normal = other.in_map(other_pose)
            n = np.array([cos(other_normal), sin(other_normal)])
            correction = about(middle, Pose2(-offset * n[0], -offset * n[1], -turn))
            information = _across(_turned_back(n, other_pose), PIECE_OFFSET_SD_M)
            information[2, 2] = 1.0 / (PIECE_SD_RAD + PIECE_END_SD_M / min(piece.length_m, other.length_m)) ** 2
            relative = other_pose.between(correction.compose(pose))
            self._trail.graph.edges.append(Edge(other.node, piece.node, relative, information, Kind.WALL))
            return

    def _meet(self, piece: WallPiece, poses: FloatArray) -> None:
        """A wall that was ahead is driven along now: how far the way towards it was, past the turn."""
        pose = Pose2.from_array(poses[piece.node])
        middle, normal_rad = piece.in_map(pose)
        n = np.array([cos(normal_rad), sin(normal_rad)])
        here = poses[piece.node, :2]
        for ahead in self._ahead:
            seen_from = Pose2.from_array(poses[ahead.node])
            start = seen_from.transform([ahead.x_m, ahead.y_m])
            beside_m = abs(float((middle - start) @ np.array([-n[1], n[0]])))
            turned_rad = wrap_angle(seen_from.heading_rad + ahead.normal_rad - normal_rad)
            if abs(turned_rad) > APPROACH_OFF_RAD or beside_m > piece.length_m / 2 + AHEAD_BESIDE_M:
                continue
            closer_m = ahead.range_m - float((middle - here) @ n)
            if self._come_nearer(ahead.node, piece.node, pose, n, float((here - start) @ n), closer_m):
                self._ahead.remove(ahead)
                return

    def _keep_right_angles(self, piece: WallPiece) -> None:
        """Where the walls so far stand at right angles, a piece that nearly does too pulls the heading, softly.

        How the right angles lie to the first heading is part of the graph: all pieces tell it together.
        """
        _, normal_rad = piece.in_map(self._trail.graph.pose(piece.node))
        self._right_angles = self._right_angles.with_direction(normal_rad, piece.length_m)
        if not self._square:
            return
        begins = not self._trail.graph.edges.of_kind(Kind.BEARING).any()
        if begins:
            self._trail.graph.slow[WALLS] = self._right_angles.direction_rad - self._trail.graph.pose(0).heading_rad
        for one in self._pieces if begins else [piece]:
            pose = self._trail.graph.pose(one.node)
            off_rad = self._off_right_angles(pose.heading_rad + one.normal_rad)
            one.upright = abs(off_rad) <= self._upright_rad(one.node) and self._stood_upright(one)
            if one.upright:
                self._upright = one.node
                heading_rad = wrap_angle(pose.heading_rad - off_rad - self._walls_rad)
                upright = Pose2(pose.x_m, pose.y_m, heading_rad)
                information = np.diag([0.0, 0.0, RIGHT_ANGLES_SD_RAD**-2])
                self._trail.graph.edges.append(Edge(0, one.node, upright, information, Kind.BEARING))

    def _stood_upright(self, piece: WallPiece) -> bool:
        """What was last concluded of the wall that a piece goes on with; true where it is a new one."""
        before = self._goes_on_with(piece, self._trail.graph.poses)
        told = [other.upright for other, turn, _ in before if other.upright is not None and abs(turn) < SAME_WALL_RAD]
        return told[-1] if told else True

    def _upright_rad(self, node: int) -> float:
        """How far off a right angle a piece may be: the further, the more the heading may have lost since the last."""
        frame, last = self._trail.frames[node], self._trail.frames[self._upright]
        drift = self._trail.errors.drift
        turned_rad, way_m = abs(frame.turned_rad - last.turned_rad), abs(frame.way_m - last.way_m)
        lost_rad = 2 * drift.rad_per_rad * turned_rad + drift.rad_per_m * way_m
        return min(self._trail.errors.upright_rad + lost_rad, UPRIGHT_MAX_RAD)

    @property
    def _square(self) -> bool:
        """Do the walls so far stand at right angles?"""
        enough = self._right_angles.weight >= RIGHT_ANGLES_WALL_M
        return enough and self._right_angles.share >= RIGHT_ANGLES_SHARE

    def _off_right_angles(self, direction_rad: float) -> float:
        """How far a direction departs from the nearest of the walls'."""
        return (direction_rad - self._walls_rad + pi / 4) % (pi / 2) - pi / 4

    @property
    def _walls_rad(self) -> float:
        """Direction of walls at right angles in the map."""
        return float(self._trail.graph.slow[WALLS]) + self._trail.graph.pose(0).heading_rad


def _turned_back(direction: FloatArray, pose: Pose2) -> FloatArray:
    """A direction (2,) of the map as seen from a pose."""
    return Pose2(0.0, 0.0, -pose.heading_rad).transform(direction)


def _across(direction: FloatArray, sd_m: float) -> FloatArray:
    """Information (3, 3) of a place that is known along `direction` (2,) only."""
    information = np.zeros((3, 3))
    information[:2, :2] = np.outer(direction, direction) / sd_m**2
    return information
