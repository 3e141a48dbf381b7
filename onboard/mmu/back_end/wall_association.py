"""Data association of straight walls: the pieces beside the path, the walls that they belong to, the right angles.

A building's walls bend by a degree here and there, and a piece of one measures the same as the next. So the direction
of a wall is a state of the graph: its pieces measure it, and it counts once among the right angles (Manhattan world).
"""

from __future__ import annotations

from math import cos, pi, radians

import numpy as np

from common.geometry import RightAngles, wrap_angle
from onboard.mmu.back_end.keyframe_graph import KeyframeGraph
from onboard.mmu.back_end.wall_landmarks import WallLandmark, WallPiece, fit_piece
from onboard.mmu.map.keyframes import in_map

# Right angles. Tuned on simulated routes and recorded robots (range logs). When every piece of a wall still counted,
# 0.25 degrees gave better maps of all simulated routes than 0.4 degrees; the other sensitivities were not measured
RIGHT_ANGLES_WALL_M = 20.0  # of pieces, which overlap, before the building counts as one with right angles
RIGHT_ANGLES_SHARE = 0.9
JUDGED_WALL_M = 4.5  # of its pieces: two at least, for the direction of one is known too badly
RIGHT_ANGLES_SD_RAD = radians(0.4)  # of one wall
SAME_MAX_RAD = radians(4.0)  # of walls that are one, or at right angles, however uncertain the heading is

# Pieces of walls. The sensitivity was not measured
PIECE_PATH_M = 3.0
PIECE_PATH_MAX_M = 6.0  # where fewer echoes than these were received in it
PIECE_ECHOES = 30
PIECE_LOOK_BACK_M = 45.0
PIECE_SD_RAD = radians(0.15)  # of a long one
PIECE_END_SD_M = 0.01
BESIDE_RAD = radians(25.0)  # how far the normal of a wall beside the path may be off square to the heading


class WallAssociation:
    """`observe` finds the newest pieces and adds their factors to the graph."""

    def __init__(self, keyframes: KeyframeGraph) -> None:
        self._keyframes = keyframes
        self._walls: list[WallLandmark] = []  # in the order of the graph's `wall_normals_rad`
        self._pieces: list[tuple[WallPiece, int]] = []  # of the path looked back over, and of which wall each is
        self._right_angles = RightAngles()  # weight: metres of wall
        self._orthogonal_node = 0  # keyframe of the newest piece of a wall at right angles, or of the very first piece

    def observe(self) -> list[WallPiece]:
        """Straight pieces among the newest echoes on both sides, each associated with its wall."""
        keyframes = self._keyframes
        rows = keyframes.echoes.newest(keyframes.path_m, PIECE_PATH_M, PIECE_PATH_MAX_M, PIECE_ECHOES)
        if len(rows) == 0:
            return []
        back_m = keyframes.path_m - PIECE_LOOK_BACK_M
        self._pieces = [(piece, wall) for piece, wall in self._pieces if piece.path_m > back_m]
        points, directions = in_map(rows, keyframes.graph.poses)
        side = np.sin(directions - keyframes.graph.pose(len(keyframes) - 1).heading_rad)
        found: list[WallPiece] = []
        for sign in (1.0, -1.0):
            mine = side * sign > cos(BESIDE_RAD)
            line = fit_piece(points[mine], directions[mine])
            if line is not None:
                node = int(rows[mine, 0][mine.sum() // 2])
                piece = WallPiece.of(line, node, keyframes.graph.pose(node), keyframes.paths_m[node])
                self._pieces.append((piece, self._add_direction(piece)))
                found.append(piece)
        self._keep_right_angles()
        return found

    def _add_direction(self, piece: WallPiece) -> int:
        """The direction of the wall relative to the heading that the robot had there; returns which wall it is."""
        index = self._associated(piece)
        wall = self._walls[index]
        wall.node, wall.length_m = piece.node, wall.length_m + piece.length_m
        sd_rad = PIECE_SD_RAD + PIECE_END_SD_M / piece.length_m
        self._keyframes.graph.wall_directions.add(piece.node, index, piece.normal_rad, sd_rad)
        return index

    def _associated(self, piece: WallPiece) -> int:
        """The newest wall that the piece continues, or a new one."""
        graph = self._keyframes.graph
        line, first_rad = piece.in_map(graph.pose(piece.node)), graph.pose(0).heading_rad
        for other, index in reversed(self._pieces):
            same_rad = self._same_rad(self._walls[index].node, piece.node)
            wall_rad = first_rad + float(graph.calibration.wall_normals_rad[index])
            if line.continues(other.in_map(graph.pose(other.node)), wall_rad, same_rad):
                return index
        if not self._walls:
            self._orthogonal_node = piece.node
        self._walls.append(WallLandmark(piece.node))
        return graph.add_wall(wrap_angle(line.normal_rad - first_rad))

    def _keep_right_angles(self) -> None:
        """Where the walls so far stand at right angles, one that nearly does too is pulled there, softly, and once.

        The direction of the right angles relative to the first heading is a state: all walls measure it together.
        """
        graph = self._keyframes.graph
        first_rad, normals_rad = graph.pose(0).heading_rad, graph.calibration.wall_normals_rad.tolist()
        self._right_angles = RightAngles()
        for wall, normal_rad in zip(self._walls, normals_rad, strict=True):
            self._right_angles = self._right_angles.with_direction(first_rad + normal_rad, wall.length_m)
        if not self.square:
            return
        if not len(graph.orthogonality):
            graph.begin_right_angles(self._right_angles.direction_rad - first_rad)
        for index, (wall, normal_rad) in enumerate(zip(self._walls, normals_rad, strict=True)):
            if wall.orthogonal is None and wall.length_m >= JUDGED_WALL_M:
                off_rad = self.off_right_angles_rad(first_rad + normal_rad)
                wall.orthogonal = abs(off_rad) <= self._same_rad(self._orthogonal_node, wall.node)
                if wall.orthogonal:
                    quarters_rad = wrap_angle(normal_rad - off_rad - graph.calibration.right_angles_rad)
                    graph.orthogonality.add(index, quarters_rad, RIGHT_ANGLES_SD_RAD)
            if wall.orthogonal:
                self._orthogonal_node = max(self._orthogonal_node, wall.node)

    @property
    def square(self) -> bool:
        """Do the walls so far stand at right angles?"""
        enough = self._right_angles.weight >= RIGHT_ANGLES_WALL_M
        return enough and self._right_angles.share >= RIGHT_ANGLES_SHARE

    def off_right_angles_rad(self, direction_rad: float) -> float:
        """How far a direction in the map departs from the nearest of the right angles."""
        graph = self._keyframes.graph
        right_angles_rad = graph.calibration.right_angles_rad + graph.pose(0).heading_rad
        return (direction_rad - right_angles_rad + pi / 4) % (pi / 2) - pi / 4

    def _same_rad(self, since: int, node: int) -> float:
        """How much a wall observed at one node may differ from one at another, by what the heading may have lost."""
        keyframe, last = self._keyframes[node], self._keyframes[since]
        prior = self._keyframes.noise.calibration
        turned_rad, path_m = abs(keyframe.turned_rad - last.turned_rad), abs(keyframe.path_m - last.path_m)
        lost_rad = 2 * prior.turn_scale_error * turned_rad + prior.drift_rad_per_m * path_m
        return min(self._keyframes.noise.same_rad + lost_rad, SAME_MAX_RAD)
