"""The back end: key frames and echoes in, corrected poses of all of them out. Runs beside the mapping unit's steps.

1. Odometry joins the key frames in the pose graph.
2. Near ties, where no gyro leads the heading: the newest stretch is registered onto the one before it.
3. Walls: a straight piece that continues an earlier one ties their key frames in heading and offset; where the
   building's walls stand at right angles, a piece that nearly does too pulls the heading, softly.
4. Loops: what was driven lately is matched against what was driven here before.
5. The graph comes to rest when it gained a tie that pulls.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, pi, radians, sin, sqrt

import numpy as np

from common.geometry import FloatArray, Points, Pose2, RightAngles, wrap_angle
from onboard.mmu.key_frames import Correction, FrameStore, Increment, KeyFrame, in_map
from onboard.mmu.pose_graph import LENGTH, TURN, WALLS, DriftPrior, Edge, Kind, PoseGraph
from onboard.mmu.scan_matching import Match, register
from onboard.mmu.wall_bend import bend
from onboard.mmu.walls import WallPiece, continuation, fit_piece

NEAR_M = 1.5  # of way: the stretch that is registered onto what came before
NEAR_GAP_M = 0.3
NEAR_REACH_M = 12.0
NEAR_POINTS_MIN = 10
NEAR_OVERLAP_MIN = 0.3
NEAR_RMS_MAX_M = 0.07
NEAR_SD_M = 0.03
NEAR_SD_RAD = radians(1.0)
BENDS_KEPT = 8
BEND_WAY_M = 5.0
BENDS_MIN = 2
BEND_SD_RAD_PER_M = radians(1.0)  # of one: niches and corners turn
BEND_SIGMAS = 5.0  # walls that together turn by so much: no gyro leads odometry
MATCH_EVERY_M = 1.0
RECENT_M = 5.0  # of way that is matched as one
LOOP_GAP_M = 12.0  # of way before a place counts as visited before
LOOP_REACH_M = 3.0
LOOP_SEARCH_M = 0.8
LOOP_SEARCH_MAX_M = 4.0
LOOP_SEARCH_RAD = 0.06
LOOP_SEARCH_MAX_RAD = 0.4
LOOP_RIVAL_MAX = 0.9
LOOP_SPAN_M = 7.0
LOOP_OVERLAP_MIN = 0.55
LOOP_RMS_MAX_M = 0.07
LOOP_POINTS_MIN = 25
LOOP_SD_M = 0.07
LOOP_SD_RAD = radians(0.6)
PASSES_MAX = 2
RIGHT_ANGLES_WALL_M = 20.0  # of wall, before anything is concluded
RIGHT_ANGLES_SHARE = 0.9
RIGHT_ANGLES_NEAR_RAD = radians(4.0)
RIGHT_ANGLES_SD_RAD = radians(0.7)  # of one piece: it is known to 0.3, and neighbouring pieces say the same
APPROACH_OFF_RAD = radians(8.0)  # a way that departs further from the walls' directions is no square approach
APPROACH_SD_M = 0.015
APPROACH_SIGMAS = 3.0  # what slip and length of the wheels do not explain was no square wall
PIECE_WAY_M = 3.0
PIECE_GAP_M = 2.5
PIECE_LOOK_BACK_M = 45.0
ADOPTED_CHI2 = 12.0  # a closure that the graph at rest pulls at more was not believed
KNOWN = np.diag([0.01**-2, 0.01**-2, radians(0.1) ** -2])  # between key frames of a map from before
CARRIED = np.diag([2.0**-2, 2.0**-2, radians(30.0) ** -2])
CARRIED_M = 200.0  # of way without a closure: how widely a robot that may have been carried is looked for
STRETCH_M = 10.0  # of travel with one drift per metre
STRAIN_MAX = 0.5  # a new tie that pulls less (chi squared) can wait


@dataclass(frozen=True, slots=True)
class OdometryErrors:
    """Of a way between key frames, as standard deviations; what the graph's two slow errors do not explain."""

    heading_rad_per_sqrt_m: float
    heading_share: float  # of the turn
    drift: DriftPrior
    lost_m_per_m: float = 0.02  # three standard deviations of the place, by the way since the last closure
    lost_rad_per_m: float = 0.002
    along_m: float = 0.003
    along_m_per_sqrt_m: float = 0.015
    across_share: float = 0.005

    def information(self, way_m: float, turn_rad: float) -> FloatArray:
        """(3, 3) of the relative pose at the end of such a way."""
        along_sd = self.along_m + self.along_m_per_sqrt_m * way_m**0.5
        across_sd = 0.003 + self.across_share * way_m
        heading_sd = radians(0.05) + self.heading_rad_per_sqrt_m * way_m**0.5 + self.heading_share * abs(turn_rad)
        return np.diag([along_sd**-2, across_sd**-2, heading_sd**-2])

    def search_window(self, since_m: float) -> tuple[float, float]:
        """How far off (metres, radians) the robot may be after so much way without a closure."""
        return (
            min(LOOP_SEARCH_M + self.lost_m_per_m * since_m, LOOP_SEARCH_MAX_M),
            min(LOOP_SEARCH_RAD + self.lost_rad_per_m * since_m, LOOP_SEARCH_MAX_RAD),
        )


LENGTH_SD = 0.007  # share of the way: what calibrated wheels get wrong
# A cheap gyro's bias wanders by 0.016 deg/s a minute: at walking pace of this robot 0.1 deg/m
GYRO_LED = OdometryErrors(
    radians(0.05),
    0.003,
    DriftPrior(radians(0.2), radians(0.1), 0.004, LENGTH_SD),
    along_m=0.001,
    along_m_per_sqrt_m=0.01,
)
UNKNOWN = OdometryErrors(radians(0.05), 0.003, DriftPrior(radians(0.1), radians(0.01), 0.01, LENGTH_SD))
WHEELS_ALONE = OdometryErrors(
    radians(1.5), 0.03, DriftPrior(radians(2.0), radians(0.1), 0.03, LENGTH_SD), 0.05, 0.006
)


@dataclass(slots=True)
class BackEnd:
    gyro_led: bool = True  # false: it is not known, and found out from the walls
    closures: int = 0
    _errors: OdometryErrors = field(init=False)
    _bends: deque[float] = field(default_factory=lambda: deque(maxlen=BENDS_KEPT))  # of walls, rad/m
    _bent_m: float = 0.0
    _near: deque[Edge] = field(default_factory=lambda: deque(maxlen=2 * BENDS_KEPT))  # ties not made
    _graph: PoseGraph = field(init=False)
    _frames: list[KeyFrame] = field(default_factory=list)
    _ways_m: list[float] = field(default_factory=list)
    _echoes: FrameStore = field(default_factory=FrameStore)
    _pieces: list[WallPiece] = field(default_factory=list)
    _right_angles: RightAngles = field(default_factory=RightAngles)  # weight: metres of wall
    _length_information: float = LENGTH_SD**-2  # of how much longer the way is than the wheels say
    _matched_m: float = 0.0
    _tied_m: float = 0.0

    def __post_init__(self) -> None:
        self._errors = GYRO_LED if self.gyro_led else UNKNOWN
        self._graph = PoseGraph(self._errors.drift)

    def take(self, increment: Increment) -> Correction:
        """One round of work on what is new."""
        for frame in increment.frames:
            self._add_frame(frame, increment.known)
        self._echoes.append(increment.echoes)
        if increment.known:
            self._matched_m = self._tied_m = self._way_m
        elif self._frames:
            self._tie_approaches(increment.approaches)
            self._tie()
        slow = self._graph.slow
        return Correction(self._graph.poses, (float(slow[-1]), float(slow[TURN])), self.closures, self._tied_m)

    def _add_frame(self, frame: KeyFrame, known: bool) -> None:
        self._ways_m.append(frame.way_m)
        if not self._frames:
            self._frames.append(frame)
            self._graph.add_node(frame.odom if known else Pose2(0.0, 0.0, 0.0))
            return
        last = self._frames[-1]
        relative = last.odom.between(frame.odom)
        added_rad = frame.calibrated_rad - last.calibrated_rad
        raw = _bent(relative, -added_rad)
        travel_m, turn_rad = frame.travel_m - last.travel_m, frame.turned_rad - last.turned_rad
        stretch = int(frame.travel_m / STRETCH_M)
        self._graph.begin_stretch(stretch)
        slow = self._graph.slow
        bend_rad = float(slow[-1]) * travel_m + float(slow[TURN]) * turn_rad
        expected = _bent(raw, bend_rad, 1.0 + float(slow[LENGTH]))
        node = self._graph.add_node(self._graph.pose(len(self._frames) - 1).compose(expected))
        if known:  # not driven: its odometry is the map itself
            travel_m = turn_rad = 0.0
        information = KNOWN if known else self._errors.information(travel_m, turn_rad)
        if not frame.certain:
            information = CARRIED
            self._tied_m = frame.way_m - CARRIED_M
        self._graph.edges.append(Edge(node - 1, node, raw, information, Kind.ODOMETRY, travel_m, turn_rad, stretch))
        self._frames.append(frame)

    @property
    def _way_m(self) -> float:
        return self._ways_m[-1]

    def _tie(self) -> None:
        """Look for ties of the recent stretch to what is known, and let the graph come to rest."""
        if not self.gyro_led:
            before = len(self._graph.edges)
            self._tie_bend()
            if self._errors is WHEELS_ALONE:
                self._tie_near()
                self._graph.edges.extend(self._near)
                self._near.clear()
            self._rest(before)
        if self._way_m - self._matched_m < MATCH_EVERY_M:
            return
        self._matched_m = self._way_m
        before = len(self._graph.edges)
        self._tie_walls()
        self._tie_loops()
        self._rest(before)

    def _rest(self, before: int) -> None:
        if len(self._graph.edges) > before and self._graph.strain(before) > STRAIN_MAX:
            self._graph.optimise(before)
        for edge in self._graph.edges[before:]:
            if edge.kind is Kind.LOOP and self._graph.chi2(edge) < ADOPTED_CHI2:
                self._tied_m = self._way_m

    def _tie_bend(self) -> None:
        """The newest stretch turned as the walls beside it seem to, the other way round."""
        if self._way_m - self._bent_m < BEND_WAY_M:
            return
        rows = self._echoes.stretch(self._bent_m, self._way_m)
        first = int(np.searchsorted(self._ways_m, self._bent_m))
        node, self._bent_m = len(self._frames) - 1, self._way_m
        raw_rad = np.array([f.odom.heading_rad - f.calibrated_rad for f in self._frames])
        bend_rad_per_m = bend(rows[:, 1], rows[:, 4] + raw_rad[rows[:, 0].astype(int)])
        if bend_rad_per_m is None:
            return
        way_m = self._ways_m[node] - self._ways_m[first]
        here = self._graph.pose(first).between(self._graph.pose(node))
        turned_rad = wrap_angle(raw_rad[node] - raw_rad[first] - bend_rad_per_m * way_m)
        information = np.diag([0.0, 0.0, (BEND_SD_RAD_PER_M * way_m) ** -2])
        self._near.append(Edge(first, node, Pose2(here.x_m, here.y_m, turned_rad), information, Kind.NEAR))
        self._bends.append(bend_rad_per_m)
        enough = len(self._bends) >= BENDS_MIN
        if enough and abs(sum(self._bends)) > BEND_SIGMAS * BEND_SD_RAD_PER_M * len(self._bends) ** 0.5:
            self._distrust_odometry()

    def _tie_near(self) -> None:
        """Register the newest stretch onto the one before it."""
        mine = self._echoes.stretch(self._way_m - NEAR_M)
        other = self._echoes.stretch(self._way_m - NEAR_M - NEAR_REACH_M, self._way_m - NEAR_M - NEAR_GAP_M)
        if len(mine) < NEAR_POINTS_MIN or len(other) < NEAR_POINTS_MIN:
            return
        poses = self._graph.poses
        node = int(np.median(mine[:, 0]))
        match = self._register(mine, other, node, poses, 0.0, 0.0)
        if match is None or match.overlap < NEAR_OVERLAP_MIN or match.rms_m > NEAR_RMS_MAX_M:
            return
        # Held by the end of the stretch before: that is what it was registered onto, most of all
        anchor = int(np.searchsorted(np.array(self._ways_m), self._way_m - NEAR_M - NEAR_GAP_M - 1.0))
        if anchor >= node:
            return
        self._near.append(self._tie_of(anchor, node, match, poses, Kind.NEAR, NEAR_SD_M, NEAR_SD_RAD))

    def _distrust_odometry(self) -> None:
        """Its heading is not led by a gyro: walls seen a moment ago know better."""
        if self._errors is WHEELS_ALONE:
            return
        self._errors = WHEELS_ALONE
        self._graph.prior = WHEELS_ALONE.drift
        self._graph.edges = [
            replace(edge, information=WHEELS_ALONE.information(edge.way_m, edge.turn_rad))
            if edge.kind is Kind.ODOMETRY
            else edge
            for edge in self._graph.edges
        ]

    def _register(
        self, mine: FloatArray, other: FloatArray, node: int, poses: FloatArray, search_m: float, search_rad: float
    ) -> Match | None:
        points, directions = in_map(mine, poses)
        fixed, fixed_directions = in_map(other, poses)
        return register(
            points, _unit(directions), fixed, _unit(fixed_directions), poses[node, :2], search_m, search_rad
        )

    def _tie_of(
        self, anchor: int, node: int, match: Match, poses: FloatArray, kind: Kind, sd_m: float, sd_rad: float
    ) -> Edge:
        corrected = _about(poses[node, :2], match.correction).compose(Pose2.from_array(poses[node]))
        reference = Pose2.from_array(poses[anchor])
        turn = Pose2(0.0, 0.0, -reference.heading_rad)
        rotation = np.eye(3)
        rotation[:2, :2] = np.stack([turn.transform([1.0, 0.0]), turn.transform([0.0, 1.0])], axis=1)
        information = rotation @ limited(match.information, sd_m, sd_rad) @ rotation.T
        return Edge(anchor, node, reference.between(corrected), information, kind)

    def _tie_approaches(self, approaches: FloatArray) -> None:
        """Where walls stand at right angles, one straight ahead says how far the way towards it was.

        Without that its normal is known to a few degrees only, and a wall at 5 degrees comes nearer by 0.4 % less.
        """
        if not self._square:
            return
        before = len(self._graph.edges)
        for far, far_x_m, far_y_m, near, near_x_m, near_y_m, closer_m in approaches.tolist():
            first, second = self._graph.pose(int(far)), self._graph.pose(int(near))
            off_rad = self._off_right_angles(second.heading_rad)
            if far == near or abs(off_rad) > APPROACH_OFF_RAD:
                continue
            normal_rad = second.heading_rad - off_rad
            n = np.array([cos(normal_rad), sin(normal_rad)])
            driven = second.transform([near_x_m, near_y_m]) - first.transform([far_x_m, far_y_m])
            way_m = float(driven @ n)
            missing = (closer_m - way_m) * n
            slip_m2 = APPROACH_SD_M**2 + self._errors.along_m_per_sqrt_m**2 * abs(way_m)
            sd_m = sqrt(slip_m2 + way_m**2 / self._length_information)
            if abs(closer_m - way_m) > APPROACH_SIGMAS * sd_m:
                continue
            self._length_information += way_m**2 / slip_m2
            n_local = Pose2(0.0, 0.0, -first.heading_rad).transform(n)
            information = np.zeros((3, 3))
            information[:2, :2] = np.outer(n_local, n_local) / APPROACH_SD_M**2
            relative = first.between(Pose2(second.x_m + missing[0], second.y_m + missing[1], second.heading_rad))
            self._graph.edges.append(Edge(int(far), int(near), relative, information, Kind.APPROACH))
        self._rest(before)

    def _tie_walls(self) -> None:
        rows = self._echoes.stretch(self._way_m - PIECE_WAY_M)
        if len(rows) == 0:
            return
        poses = self._graph.poses
        node = len(self._frames) - 1
        points, directions = in_map(rows, poses)
        pose = self._graph.pose(node)
        side = np.sin(directions - pose.heading_rad)
        for sign in (1.0, -1.0):
            mine = side * sign > cos(radians(25.0))
            piece = fit_piece(points[mine], directions[mine])
            if piece is None:
                continue
            middle, normal_rad, length_m = piece
            self._continue_wall(node, pose, middle, normal_rad, length_m, poses)
            local = pose.inverse().transform(middle)
            turned_rad = wrap_angle(normal_rad - pose.heading_rad)
            self._pieces.append(WallPiece(node, self._way_m, float(local[0]), float(local[1]), turned_rad, length_m))
            self._keep_right_angles(self._pieces[-1], normal_rad)

    def _continue_wall(
        self, node: int, pose: Pose2, middle: FloatArray, normal_rad: float, length_m: float, poses: FloatArray
    ) -> None:
        """Tie the piece to the earliest one of the same wall in the stretch looked back over."""
        for other in self._pieces:
            behind_m = self._way_m - other.way_m
            if not PIECE_GAP_M <= behind_m <= PIECE_LOOK_BACK_M:
                continue
            other_pose = Pose2.from_array(poses[other.node])
            other_middle, other_normal = other.in_map(other_pose)
            departs = continuation(middle, normal_rad, length_m, other_middle, other_normal, other.length_m)
            if departs is None:
                continue
            turn, offset = departs
            n = np.array([cos(other_normal), sin(other_normal)])
            correction = _about(middle, Pose2(-offset * n[0], -offset * n[1], -turn))
            n_local = Pose2(0.0, 0.0, -other_pose.heading_rad).transform(n)
            information = np.zeros((3, 3))
            information[:2, :2] = np.outer(n_local, n_local) / 0.10**2
            information[2, 2] = 1.0 / (radians(0.5) + 0.03 / min(length_m, other.length_m) / 3) ** 2
            relative = other_pose.between(correction.compose(pose))
            self._graph.edges.append(Edge(other.node, node, relative, information, Kind.WALL))
            return

    def _keep_right_angles(self, piece: WallPiece, normal_rad: float) -> None:
        """Where the walls so far stand at right angles, a piece that nearly does too pulls the heading, softly.

        How the right angles lie to the first heading is part of the graph: all pieces tell it together.
        """
        self._right_angles = self._right_angles.with_direction(normal_rad, piece.length_m)
        if not self._square:
            return
        begins = not any(edge.kind is Kind.BEARING for edge in self._graph.edges)
        if begins:
            self._graph.slow[WALLS] = self._right_angles.direction_rad - self._graph.pose(0).heading_rad
        for one in self._pieces if begins else [piece]:
            pose = self._graph.pose(one.node)
            off_rad = self._off_right_angles(pose.heading_rad + one.normal_rad)
            if abs(off_rad) <= RIGHT_ANGLES_NEAR_RAD:
                heading_rad = wrap_angle(pose.heading_rad - off_rad - self._walls_rad)
                upright = Pose2(pose.x_m, pose.y_m, heading_rad)
                information = np.diag([0.0, 0.0, RIGHT_ANGLES_SD_RAD**-2])
                self._graph.edges.append(Edge(0, one.node, upright, information, Kind.BEARING))

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
        return float(self._graph.slow[WALLS]) + self._graph.pose(0).heading_rad

    def _tie_loops(self) -> None:
        rows = self._echoes.stretch(self._way_m - RECENT_M)
        if len(rows) < LOOP_POINTS_MIN:
            return
        poses = self._graph.poses
        here = poses[-1]
        ways = np.array(self._ways_m)
        old = ways < self._way_m - RECENT_M - LOOP_GAP_M
        near = np.hypot(poses[:, 0] - here[0], poses[:, 1] - here[1])
        near[~old] = np.inf
        mine = int(np.median(rows[:, 0]))
        reach_m = LOOP_REACH_M + self._errors.search_window(self._way_m - self._tied_m)[0]
        for _ in range(PASSES_MAX):
            reachable = np.flatnonzero(near < reach_m)
            if not len(reachable):
                return
            first = ways[reachable[0]]
            of_pass = reachable[ways[reachable] < first + 2 * LOOP_REACH_M]
            self._match_pass(int(of_pass[near[of_pass].argmin()]), mine, rows, poses)
            near[ways < first + 2 * LOOP_SPAN_M] = np.inf

    def _match_pass(self, node: int, mine: int, recent: FloatArray, poses: FloatArray) -> None:
        way_m = self._ways_m[node]
        end_m = min(way_m + LOOP_SPAN_M, self._way_m - RECENT_M - 2.0)
        rows = self._echoes.stretch(way_m - LOOP_SPAN_M, end_m)
        if len(rows) < LOOP_POINTS_MIN:
            return
        since_m = self._way_m - self._tied_m
        search_m, search_rad = self._errors.search_window(since_m)
        match = self._register(recent, rows, mine, poses, search_m, search_rad)
        if (
            match is None
            or match.overlap < LOOP_OVERLAP_MIN
            or match.rms_m > LOOP_RMS_MAX_M
            or match.overlap * len(recent) < LOOP_POINTS_MIN
            or match.rival > LOOP_RIVAL_MAX
        ):
            return
        self.closures += 1
        self._graph.edges.append(self._tie_of(node, mine, match, poses, Kind.LOOP, LOOP_SD_M, LOOP_SD_RAD))


def limited(information: FloatArray, sd_m: float, sd_rad: float) -> FloatArray:
    """No match is trusted further than the sonars' own systematic errors, in no direction."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    out = np.zeros((3, 3))
    out[:2, :2] = (vectors * np.minimum(values, sd_m**-2)) @ vectors.T
    out[2, 2] = min(float(information[2, 2]), sd_rad**-2)
    return out


def _unit(directions_rad: FloatArray) -> Points:
    return np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=1)


def _bent(relative: Pose2, bend_rad: float, longer: float = 1.0) -> Pose2:
    """A way that turned by `bend_rad` more than `relative` says, evenly, and is so many times as long."""
    c, s = cos(bend_rad / 2), sin(bend_rad / 2)
    x, y = longer * relative.x_m, longer * relative.y_m
    return Pose2(c * x - s * y, s * x + c * y, wrap_angle(relative.heading_rad + bend_rad))


def _about(centre: FloatArray, motion: Pose2) -> Pose2:
    """A rotation about `centre` followed by a shift, as one motion of the map."""
    rotated = Pose2(0.0, 0.0, motion.heading_rad).transform(centre)
    return Pose2(
        float(centre[0] - rotated[0]) + motion.x_m, float(centre[1] - rotated[1]) + motion.y_m, motion.heading_rad
    )
