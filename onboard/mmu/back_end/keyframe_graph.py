"""Keyframes as nodes of the pose graph, joined by odometry, with the echoes that were received from each."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from common.geometry import FloatArray, Points, Pose2, wrap_angle
from onboard.mmu.back_end.odometry_noise import OdometryNoise
from onboard.mmu.back_end.pose_graph import PoseGraph
from onboard.mmu.front_end.scan_matching import Match, register
from onboard.mmu.map.keyframes import Keyframe, ObservationStore, StatedPose, in_map

# Standard deviations and lengths are rough on purpose. The sensitivity was not measured
PRIOR_MAP = np.diag([0.01**-2, 0.01**-2, radians(0.1) ** -2])  # information between keyframes of a prior map
KIDNAPPED = np.diag([2.0**-2, 2.0**-2, radians(30.0) ** -2])  # where the robot may have been kidnapped in between
KIDNAPPED_M = 200.0  # of path without a loop closure: as widely a kidnapped robot is searched for
STRETCH_M = 10.0  # of travel with one value of the drift
CLOSURE_M = 2.0  # path that loses as much as a loop closure leaves open
EDGE_MIN_M = 1e-3  # a sparse matrix takes a way of no length for none


class KeyframeGraph:
    """`graph` has a node for each keyframe; `paths_m` is the path at each (m), `echoes` all that were received."""

    def __init__(self, noise: OdometryNoise) -> None:
        self.noise = noise
        self.graph = PoseGraph(noise.calibration)
        self.paths_m: list[float] = []
        self.echoes = ObservationStore()
        self.closure_path_m = 0.0  # path at the newest loop closure that was adopted
        self._keyframes: list[Keyframe] = []
        self._edges: list[tuple[int, int, float]] = []  # two nodes, and the path (m) that they are lost by

    def __len__(self) -> int:
        return len(self._keyframes)

    def __getitem__(self, node: int) -> Keyframe:
        return self._keyframes[node]

    @property
    def path_m(self) -> float:
        return self.paths_m[-1]

    def graph_paths_m(self) -> FloatArray:
        """(K,) the shortest path through the graph from each node to the newest: a loop closure is a shortcut."""
        edges = np.array(self._edges, dtype=np.float64).reshape(-1, 3)
        nodes = edges[:, 0].astype(int), edges[:, 1].astype(int)
        graph = csr_matrix((np.maximum(edges[:, 2], EDGE_MIN_M), nodes), shape=(len(self), len(self)))
        graph_paths_m: FloatArray = np.asarray(dijkstra(graph, directed=False, indices=[len(self) - 1]))[0]
        return graph_paths_m

    def close_loop(self, anchor: int, node: int) -> None:
        """A loop closure between the nodes was adopted."""
        self._edges.append((anchor, node, CLOSURE_M))
        self.closure_path_m = self.path_m

    @property
    def measured_headings_rad(self) -> FloatArray:
        """(K,) by raw odometry, without the calibration."""
        return np.array([keyframe.odom.heading_rad - keyframe.calibrated_rad for keyframe in self._keyframes])

    def add(self, keyframe: Keyframe, prior_map: bool) -> None:
        """The next node, joined by odometry; `prior_map`: it comes from a prior map, which is its own odometry."""
        self.paths_m.append(keyframe.path_m)
        if not self._keyframes:
            self._keyframes.append(keyframe)
            self.graph.add_node(keyframe.odom if prior_map else Pose2(0.0, 0.0, 0.0))
            return
        last = self._keyframes[-1]
        measured = _bent(last.odom.between(keyframe.odom), last.calibrated_rad - keyframe.calibrated_rad)
        travel_m, turn_rad = keyframe.travel_m - last.travel_m, keyframe.turned_rad - last.turned_rad
        stretch = int(keyframe.travel_m / STRETCH_M)
        self.graph.begin_stretch(stretch)
        calibration = self.graph.calibration
        bend_rad = float(calibration.drift_rad_per_m[-1]) * travel_m + calibration.turn_scale_error * turn_rad
        expected = _bent(measured, bend_rad, 1.0 + calibration.wheel_scale_error)
        node = self.graph.add_node(self.graph.pose(len(self) - 1).compose(expected))
        if prior_map:  # not driven
            travel_m = turn_rad = 0.0
        information = PRIOR_MAP if prior_map else self.noise.information(travel_m, turn_rad, keyframe.slip_m_per_sqrt_m)
        lost_m = 0.0 if prior_map else keyframe.path_m - last.path_m
        if not keyframe.certain:
            information, lost_m = KIDNAPPED, KIDNAPPED_M
            self.closure_path_m = keyframe.path_m - KIDNAPPED_M
        self._edges.append((node - 1, node, lost_m))
        self.graph.odometry.add(node - 1, node, measured, information, travel_m, turn_rad, stretch)
        self._keyframes.append(keyframe)
        if keyframe.stated is not None:
            self._add_stated(node, keyframe.stated)

    def _add_stated(self, node: int, stated: StatedPose) -> None:
        """As lost as after a path that loses as much; a loop closure near there settles it."""
        information = np.diag([stated.sd_m**-2, stated.sd_m**-2, stated.sd_rad**-2])
        self.graph.stated_poses.add(stated.anchor, node, stated.pose, information)
        lost_m = max(3 * stated.sd_m / self.noise.lost_m_per_m, 3 * stated.sd_rad / self.noise.lost_rad_per_m)
        self._edges.append((stated.anchor, node, lost_m))

    def register(
        self,
        mine: FloatArray,
        other: FloatArray,
        node: int,
        search_m: float,
        search_rad: float,
        begin_at: int | None = None,
    ) -> Match | None:
        """Rows of echoes (N, 6) onto others (M, 6), turned about `node`; searched only where a window is given.

        `begin_at`: the node that they are moved to first, where it is another one.
        """
        poses = self.graph.poses
        points, directions = in_map(mine, poses)
        fixed, fixed_directions = in_map(other, poses)
        begin = poses[node if begin_at is None else begin_at, :2]
        shift = begin - poses[node, :2]
        match = register(points + shift, _unit(directions), fixed, _unit(fixed_directions), begin, search_m, search_rad)
        if match is None or begin_at is None:
            return match
        found = match.correction
        moved = Pose2(found.x_m + float(shift[0]), found.y_m + float(shift[1]), found.heading_rad)
        return replace(match, correction=moved)

    def measured(self, anchor: int, node: int, match: Match, sd_m: float, sd_rad: float) -> tuple[Pose2, FloatArray]:
        """The pose of `node` as seen from `anchor` by a match, and its information (3, 3) there.

        Trusted no further than the standard deviations.
        """
        pose = self.graph.pose(node)
        corrected = about(pose.as_array()[:2], match.correction).compose(pose)
        reference = self.graph.pose(anchor)
        turn = Pose2(0.0, 0.0, -reference.heading_rad)
        rotation = np.eye(3)
        rotation[:2, :2] = np.stack([turn.transform([1.0, 0.0]), turn.transform([0.0, 1.0])], axis=1)
        information = rotation @ limited(match.information, sd_m, sd_rad) @ rotation.T
        return reference.between(corrected), information


def limited(information: FloatArray, sd_m: float, sd_rad: float) -> FloatArray:
    """(3, 3): no match is trusted further than the sonars' own systematic errors, in no direction."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    out = np.zeros((3, 3))
    out[:2, :2] = (vectors * np.minimum(values, sd_m**-2)) @ vectors.T
    out[2, 2] = min(float(information[2, 2]), sd_rad**-2)
    return out


def about(centre: FloatArray, motion: Pose2) -> Pose2:
    """A rotation about `centre` (2,) followed by a shift, as one motion of the map."""
    rotated = Pose2(0.0, 0.0, motion.heading_rad).transform(centre)
    return Pose2(
        float(centre[0] - rotated[0]) + motion.x_m, float(centre[1] - rotated[1]) + motion.y_m, motion.heading_rad
    )


def _unit(directions_rad: FloatArray) -> Points:
    return np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=1)


def _bent(relative: Pose2, bend_rad: float, scale: float = 1.0) -> Pose2:
    """A path that turned evenly by `bend_rad` more than `relative`, and is `scale` times as long."""
    c, s = cos(bend_rad / 2), sin(bend_rad / 2)
    x, y = scale * relative.x_m, scale * relative.y_m
    return Pose2(c * x - s * y, s * x + c * y, wrap_angle(relative.heading_rad + bend_rad))
