"""What straight walls tell: of the heading, each its own direction and all their right angles; of the way, one ahead.

A building's walls bend by a degree here and there, and a piece of one says the same as the next. So a wall's direction
is a value of the graph: its pieces tell it, and it counts once among the right angles each time it is driven along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, pi, radians, sin, sqrt

import numpy as np

from common.geometry import FloatArray, Pose2, RightAngles, wrap_angle
from onboard.mmu.back_end.factors import Edge, Kind
from onboard.mmu.back_end.keyframe_graph import Trail
from onboard.mmu.back_end.odometry_noise import LENGTH_SD
from onboard.mmu.back_end.pose_graph import WALLS
from onboard.mmu.back_end.wall_landmarks import Wall, WallAhead, WallPiece, fit_piece
from onboard.mmu.map.keyframes import in_map

RIGHT_ANGLES_WALL_M = 20.0  # of pieces, which overlap, before anything is concluded
RIGHT_ANGLES_SHARE = 0.9
JUDGED_WALL_M = 4.5  # of its pieces: two at least, for the direction of one is known too badly
RIGHT_ANGLES_SD_RAD = radians(0.4)  # of one wall
SAME_MAX_RAD = radians(4.0)  # of walls that are one, or at right angles, however uncertain the heading is
APPROACH_OFF_RAD = radians(8.0)  # a way that departs further from the walls' directions is no square approach
APPROACH_SD_M = 0.01
APPROACH_SIGMAS = 3.0  # what slip and length of the wheels do not explain was no square wall
AHEAD_WAY_M = 15.0  # by then it is driven along, or it was another one
AHEAD_BESIDE_M = 1.0  # from where it was seen ahead to where it is driven along
PIECE_WAY_M = 3.0
PIECE_LOOK_BACK_M = 45.0
PIECE_SD_RAD = radians(0.15)  # of a long one
PIECE_END_SD_M = 0.01


@dataclass(slots=True)
class WallTies:
    _trail: Trail
    _walls: list[Wall] = field(default_factory=list)  # in the order of the graph's `walls_rad`
    _pieces: list[tuple[WallPiece, int]] = field(default_factory=list)  # of the way looked back over, and of which wall
    _right_angles: RightAngles = field(default_factory=RightAngles)  # weight: metres of wall
    _upright: int = 0  # key frame of the newest piece of a wall at right angles, or of the very first piece
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
        """Straight pieces among the newest echoes on both sides: they tell how the walls lie that they belong to."""
        rows = self._trail.echoes.stretch(self._trail.way_m - PIECE_WAY_M)
        if len(rows) == 0:
            return
        back_m = self._trail.way_m - PIECE_LOOK_BACK_M
        self._pieces = [(piece, slot) for piece, slot in self._pieces if piece.way_m > back_m]
        self._ahead = [ahead for ahead in self._ahead if ahead.way_m > self._trail.way_m - AHEAD_WAY_M]
        points, directions = in_map(rows, self._trail.graph.poses)
        side = np.sin(directions - self._trail.graph.pose(len(self._trail.frames) - 1).heading_rad)
        for sign in (1.0, -1.0):
            mine = side * sign > cos(radians(25.0))
            line = fit_piece(points[mine], directions[mine])
            if line is not None:
                node = int(rows[mine, 0][mine.sum() // 2])
                piece = WallPiece.of(line, node, self._trail.graph.pose(node), self._trail.ways_m[node])
                self._pieces.append((piece, self._tell_wall(piece)))
                self._meet(piece)
        self._keep_right_angles()

    def _tell_wall(self, piece: WallPiece) -> int:
        """How the wall lies to the heading that the robot had there; returns which wall it is."""
        slot = self._wall_of(piece)
        wall = self._walls[slot]
        wall.node, wall.length_m = piece.node, wall.length_m + piece.length_m
        sd_rad = PIECE_SD_RAD + PIECE_END_SD_M / piece.length_m
        heading = Pose2(0.0, 0.0, -piece.normal_rad)
        information = np.diag([0.0, 0.0, sd_rad**-2])
        self._trail.graph.edges.append(Edge(0, piece.node, heading, information, Kind.BEARING, slot=slot))
        return slot

    def _wall_of(self, piece: WallPiece) -> int:
        """The newest wall that the piece goes on with, or a new one."""
        graph = self._trail.graph
        line, first_rad = piece.in_map(graph.pose(piece.node)), graph.pose(0).heading_rad
        for other, slot in reversed(self._pieces):
            same_rad = self._same_rad(self._walls[slot].node, piece.node)
            wall_rad = first_rad + float(graph.walls_rad[slot])
            if line.goes_on(other.in_map(graph.pose(other.node)), wall_rad, same_rad):
                return slot
        if not self._walls:
            self._upright = piece.node
        self._walls.append(Wall(piece.node))
        return graph.add_wall(wrap_angle(line.normal_rad - first_rad))

    def _meet(self, piece: WallPiece) -> None:
        """A wall that was ahead is driven along now: how far the way towards it was, past the turn."""
        pose = self._trail.graph.pose(piece.node)
        line = piece.in_map(pose)
        n = np.array([cos(line.normal_rad), sin(line.normal_rad)])
        here = np.array([pose.x_m, pose.y_m])
        for ahead in self._ahead:
            seen_from = self._trail.graph.pose(ahead.node)
            start = seen_from.transform([ahead.x_m, ahead.y_m])
            beside_m = abs(float((line.middle - start) @ np.array([-n[1], n[0]])))
            turned_rad = wrap_angle(seen_from.heading_rad + ahead.normal_rad - line.normal_rad)
            if (
                ahead.node >= piece.node
                or abs(turned_rad) > APPROACH_OFF_RAD
                or beside_m > piece.length_m / 2 + AHEAD_BESIDE_M
            ):
                continue
            closer_m = ahead.range_m - float((line.middle - here) @ n)
            if self._come_nearer(ahead.node, piece.node, pose, n, float((here - start) @ n), closer_m):
                self._ahead.remove(ahead)
                return

    def _keep_right_angles(self) -> None:
        """Where the walls so far stand at right angles, one that nearly does too pulls its direction, softly, and once.

        How the right angles lie to the first heading is part of the graph: all walls tell it together.
        """
        graph = self._trail.graph
        first_rad = graph.pose(0).heading_rad
        self._right_angles = RightAngles()
        for wall, normal_rad in zip(self._walls, graph.walls_rad.tolist(), strict=True):
            self._right_angles = self._right_angles.with_direction(first_rad + normal_rad, wall.length_m)
        if not self._square:
            return
        if not graph.edges.of_kind(Kind.UPRIGHT).any():
            graph.slow[WALLS] = self._right_angles.direction_rad - first_rad
        for slot, (wall, normal_rad) in enumerate(zip(self._walls, graph.walls_rad.tolist(), strict=True)):
            if wall.upright is None and wall.length_m >= JUDGED_WALL_M:
                off_rad = self._off_right_angles(first_rad + normal_rad)
                wall.upright = abs(off_rad) <= self._same_rad(self._upright, wall.node)
                if wall.upright:
                    square = Pose2(0.0, 0.0, wrap_angle(normal_rad - off_rad - float(graph.slow[WALLS])))
                    information = np.diag([0.0, 0.0, RIGHT_ANGLES_SD_RAD**-2])
                    graph.edges.append(Edge(0, 0, square, information, Kind.UPRIGHT, slot=slot))
            if wall.upright:
                self._upright = max(self._upright, wall.node)

    def _same_rad(self, since: int, node: int) -> float:
        """By how much a wall seen from a node may differ from one seen from another, by what the heading may lose."""
        frame, last = self._trail.frames[node], self._trail.frames[since]
        drift = self._trail.errors.drift
        turned_rad, way_m = abs(frame.turned_rad - last.turned_rad), abs(frame.way_m - last.way_m)
        lost_rad = 2 * drift.rad_per_rad * turned_rad + drift.rad_per_m * way_m
        return min(self._trail.errors.same_rad + lost_rad, SAME_MAX_RAD)

    @property
    def _square(self) -> bool:
        """Do the walls so far stand at right angles?"""
        enough = self._right_angles.weight >= RIGHT_ANGLES_WALL_M
        return enough and self._right_angles.share >= RIGHT_ANGLES_SHARE

    def _off_right_angles(self, direction_rad: float) -> float:
        """How far a direction departs from the nearest of the walls'."""
        return (direction_rad - self._right_angles_rad + pi / 4) % (pi / 2) - pi / 4

    @property
    def _right_angles_rad(self) -> float:
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
