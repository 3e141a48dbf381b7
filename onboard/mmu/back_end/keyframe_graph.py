"""What was driven and heard so far, joined by the pose graph: where ties of every kind are looked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, radians, sin

import numpy as np

from common.geometry import FloatArray, Points, Pose2, wrap_angle
from onboard.mmu.back_end.factors import Edge, Kind
from onboard.mmu.back_end.odometry_noise import WHEELS_ALONE, OdometryErrors
from onboard.mmu.back_end.pose_graph import LENGTH, TURN, PoseGraph
from onboard.mmu.front_end.scan_matching import Match, register
from onboard.mmu.map.keyframes import FrameStore, KeyFrame, in_map

KNOWN = np.diag([0.01**-2, 0.01**-2, radians(0.1) ** -2])  # between key frames of a map from before
CARRIED = np.diag([2.0**-2, 2.0**-2, radians(30.0) ** -2])
CARRIED_M = 200.0  # of way without a closure: how widely a robot that may have been carried is looked for
STRETCH_M = 10.0  # of travel with one drift per metre


@dataclass(slots=True)
class Trail:
    """Key frames as nodes of `graph`, the way (m) at each, and the echoes heard from them."""

    errors: OdometryErrors
    graph: PoseGraph = field(init=False)
    frames: list[KeyFrame] = field(default_factory=list)
    ways_m: list[float] = field(default_factory=list)
    echoes: FrameStore = field(default_factory=FrameStore)
    tied_m: float = 0.0  # way at the newest tie to a place visited before

    def __post_init__(self) -> None:
        self.graph = PoseGraph(self.errors.drift)

    @property
    def way_m(self) -> float:
        return self.ways_m[-1]

    def add_frame(self, frame: KeyFrame, known: bool) -> None:
        """The next node, joined by odometry; `known`: it is of a map from before, which is its own odometry."""
        self.ways_m.append(frame.way_m)
        if not self.frames:
            self.frames.append(frame)
            self.graph.add_node(frame.odom if known else Pose2(0.0, 0.0, 0.0))
            return
        last = self.frames[-1]
        relative = last.odom.between(frame.odom)
        added_rad = frame.calibrated_rad - last.calibrated_rad
        raw = _bent(relative, -added_rad)
        travel_m, turn_rad = frame.travel_m - last.travel_m, frame.turned_rad - last.turned_rad
        stretch = int(frame.travel_m / STRETCH_M)
        self.graph.begin_stretch(stretch)
        slow = self.graph.slow
        bend_rad = float(slow[-1]) * travel_m + float(slow[TURN]) * turn_rad
        expected = _bent(raw, bend_rad, 1.0 + float(slow[LENGTH]))
        node = self.graph.add_node(self.graph.pose(len(self.frames) - 1).compose(expected))
        if known:  # not driven
            travel_m = turn_rad = 0.0
        information = KNOWN if known else self.errors.information(travel_m, turn_rad, frame.slip_m_per_sqrt_m)
        if not frame.certain:
            information = CARRIED
            self.tied_m = frame.way_m - CARRIED_M
        self.graph.edges.append(Edge(node - 1, node, raw, information, Kind.ODOMETRY, travel_m, turn_rad, stretch))
        self.frames.append(frame)

    def distrust_odometry(self) -> None:
        """Its heading is not led by a gyro: what was tied while that was believed is looked at no more."""
        self.errors = WHEELS_ALONE
        self.graph.prior, self.graph.walls_rad = WHEELS_ALONE.drift, np.zeros(0)
        edges = self.graph.edges
        edges.keep(edges.of_kind(Kind.ODOMETRY))
        for row in edges.rows:
            row["information"] = WHEELS_ALONE.information(row["way_m"], row["turn_rad"])

    def register(
        self, mine: FloatArray, other: FloatArray, node: int, search_m: float, search_rad: float
    ) -> Match | None:
        """Rows of echoes (N, 6) onto others (M, 6), turned about `node`; searched only where a window is given."""
        poses = self.graph.poses
        points, directions = in_map(mine, poses)
        fixed, fixed_directions = in_map(other, poses)
        return register(
            points, _unit(directions), fixed, _unit(fixed_directions), poses[node, :2], search_m, search_rad
        )

    def tie(self, anchor: int, node: int, match: Match, kind: Kind, sd_m: float, sd_rad: float) -> Edge:
        """What a match says of `node` as seen from `anchor`, trusted no further than the standard deviations."""
        pose = self.graph.pose(node)
        corrected = about(pose.as_array()[:2], match.correction).compose(pose)
        reference = self.graph.pose(anchor)
        turn = Pose2(0.0, 0.0, -reference.heading_rad)
        rotation = np.eye(3)
        rotation[:2, :2] = np.stack([turn.transform([1.0, 0.0]), turn.transform([0.0, 1.0])], axis=1)
        information = rotation @ limited(match.information, sd_m, sd_rad) @ rotation.T
        return Edge(anchor, node, reference.between(corrected), information, kind)


def limited(information: FloatArray, sd_m: float, sd_rad: float) -> FloatArray:
    """No match is trusted further than the sonars' own systematic errors, in no direction."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    out = np.zeros((3, 3))
    out[:2, :2] = (vectors * np.minimum(values, sd_m**-2)) @ vectors.T
    out[2, 2] = min(float(information[2, 2]), sd_rad**-2)
    return out


def about(centre: FloatArray, motion: Pose2) -> Pose2:
    """A rotation about `centre` followed by a shift, as one motion of the map."""
    rotated = Pose2(0.0, 0.0, motion.heading_rad).transform(centre)
    return Pose2(
        float(centre[0] - rotated[0]) + motion.x_m, float(centre[1] - rotated[1]) + motion.y_m, motion.heading_rad
    )


def _unit(directions_rad: FloatArray) -> Points:
    return np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=1)


def _bent(relative: Pose2, bend_rad: float, longer: float = 1.0) -> Pose2:
    """A way that turned by `bend_rad` more than `relative` says, evenly, and is so many times as long."""
    c, s = cos(bend_rad / 2), sin(bend_rad / 2)
    x, y = longer * relative.x_m, longer * relative.y_m
    return Pose2(c * x - s * y, s * x + c * y, wrap_angle(relative.heading_rad + bend_rad))
