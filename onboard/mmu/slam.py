"""Simultaneous localisation and mapping from a few fixed beams: the mapping unit without its messages.

1. Odometry filter: pose in `odom`, continuous.
2. Surroundings: ranges -> echoes on walls with normals, and free rays.
3. Key frames every 0.4 m hold their echoes; odometry joins them in the pose graph.
4. Walls: a straight piece that continues an earlier one ties their key frames in heading and offset.
5. Loops: what was driven lately is matched against what was driven here before.
6. The graph is optimised when it gained such a tie; grid and wall points are drawn from the key frames as they lie now.
"""

from __future__ import annotations

from cmath import phase, rect
from dataclasses import dataclass, field
from math import cos, hypot, pi, radians, sin

import numpy as np

from common.constants import SONAR_BEARINGS_RAD
from common.geometry import FloatArray, Points, Pose2, wrap_angle
from common.messages import Odometry, Ranges
from onboard.mmu.occupancy import OccupancyGrid
from onboard.mmu.odometry import OdometryFilter
from onboard.mmu.pose_graph import Edge, PoseGraph
from onboard.mmu.scan_matching import register
from onboard.mmu.surroundings import Echo, Ray, Surroundings
from onboard.mmu.walls import WallPiece, continuation, fit_piece

KEY_FRAME_M = 0.4
KEY_FRAME_RAD = 0.35
POSES_KEPT = 60  # of recent odometry, for dating ranges
MATCH_EVERY_M = 1.0
RECENT_M = 5.0  # of travel that is matched as one
LOOP_GAP_M = 12.0  # of travel before a place counts as visited before
LOOP_REACH_M = 4.0
LOOP_SPAN_M = 7.0
LOOP_OVERLAP_MIN = 0.55
LOOP_RMS_MAX_M = 0.07
LOOP_POINTS_MIN = 30
LOOP_SD_M = 0.07
LOOP_SD_RAD = radians(0.6)
PASSES_MAX = 2
RIGHT_ANGLES_WALL_M = 20.0  # of wall, before anything is concluded
RIGHT_ANGLES_SHARE = 0.9  # mean resultant length of four times the direction
RIGHT_ANGLES_NEAR_RAD = radians(4.0)
RIGHT_ANGLES_SD_RAD = radians(2.0)  # of one piece; neighbouring pieces say the same
PIECE_TRAVEL_M = 3.0
PIECE_GAP_M = 2.5
PIECE_LOOK_BACK_M = 45.0
STRAIN_MAX = 0.5  # a new tie that pulls less (chi squared) can wait
SD_MAX_M = 2.5
REDRAW_ROWS = 300  # of rays that a new grid takes in per report: a step must stay short
REDRAW_M = 0.04  # a correction larger than this redraws map and grid


@dataclass(slots=True)
class FrameStore:
    """Directed lengths (echoes, free rays), each in the frame of its key frame; grows by doubling."""

    count: int = 0
    _rows: FloatArray = field(default_factory=lambda: np.zeros((1024, 6)))  # node, travel, x, y, direction, length

    def add(self, node: int, travel_m: float, x_m: float, y_m: float, direction_rad: float, length_m: float) -> None:
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self.count] = (node, travel_m, x_m, y_m, direction_rad, length_m)
        self.count += 1

    def rows(self, start: int = 0) -> FloatArray:
        """(N, 6) from the `start`-th on."""
        return self._rows[start : self.count]

    def stretch(self, travel_from_m: float, travel_to_m: float = float("inf")) -> FloatArray:
        """(N, 6) of a stretch of travel."""
        rows = self._rows[: self.count]
        return rows[(rows[:, 1] >= travel_from_m) & (rows[:, 1] <= travel_to_m)]


def in_map(rows: FloatArray, poses: FloatArray) -> tuple[Points, FloatArray]:
    """Points (N, 2) and directions (N,) in the map of echo rows, given all key frame poses (K, 3)."""
    p = poses[rows[:, 0].astype(int)]
    c, s = np.cos(p[:, 2]), np.sin(p[:, 2])
    x, y = rows[:, 2], rows[:, 3]
    return np.stack([p[:, 0] + c * x - s * y, p[:, 1] + s * x + c * y], axis=1), rows[:, 4] + p[:, 2]


@dataclass(slots=True)
class KeyFrame:
    t_s: float
    odom: Pose2
    travel_m: float


class Slam:
    """The whole of it. `add_odometry` and `add_ranges` take the reports in as they come; the rest is read off."""

    def __init__(self, bearings_rad: tuple[float, ...] = SONAR_BEARINGS_RAD) -> None:
        self._odometry = OdometryFilter()
        self._surroundings = Surroundings(bearings_rad)
        self._recent: list[tuple[float, Pose2]] = []
        self._frames: list[KeyFrame] = []
        self._graph = PoseGraph()
        self._echoes = FrameStore()
        self._rays = FrameStore()
        self._pieces: list[WallPiece] = []
        self._directions = 0j  # metres of wall as unit vectors at four times their direction, summed
        self._directions_m = 0.0
        self._travel_m = 0.0
        self._matched_m = 0.0
        self._drawn = (0, 0)  # echoes and rays in the grid
        self._drawing: tuple[OccupancyGrid, tuple[int, int]] | None = None  # the next grid, and what it has
        self.grid = OccupancyGrid()
        self.revision = 0
        self.closures = 0
        self._last_closure_m = 0.0
        self._last_loop_m = 0.0

    @property
    def pose(self) -> Pose2:
        """Where the robot is in the map."""
        if not self._frames:
            return Pose2(0.0, 0.0, 0.0)
        return self._graph.pose(len(self._frames) - 1).compose(self._frames[-1].odom.between(self._odometry.pose))

    @property
    def travel_m(self) -> float:
        return self._travel_m

    @property
    def uncertainty(self) -> tuple[float, float]:
        """Standard deviations of position (metres) and heading (radians) since the last tie to known walls."""
        since_m = self._travel_m - self._last_closure_m
        return min(0.03 + 0.01 * since_m, SD_MAX_M), radians(0.3) + radians(0.05) * since_m

    def add_odometry(self, odometry: Odometry) -> bool:
        """Take in one report. False: it did not go on from the one before (the board restarted or jumped)."""
        goes_on = self._odometry.update(odometry)
        pose = self._odometry.pose
        if self._recent:
            self._travel_m += self._recent[-1][1].distance_m(pose)
        self._recent.append((odometry.t_s, pose))
        del self._recent[:-POSES_KEPT]
        if self._new_key_frame_due(pose):
            self._add_key_frame(odometry.t_s, pose)
        if self._travel_m - self._matched_m >= MATCH_EVERY_M:
            self._matched_m = self._travel_m
            self._tie()
        self._draw_on()
        return goes_on

    def add_ranges(self, ranges: Ranges) -> None:
        """Take in one report; ranges from before the first odometry are of no use."""
        if self._recent:
            self._store(*self._surroundings.add(ranges.t_s, self._recent, ranges.range_m, ranges.age_s))

    def trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Times (K,) and poses (K, 3) of the key frames as they lie now."""
        return np.array([f.t_s for f in self._frames]), self._graph.poses

    def wall_points(self, start: int = 0) -> Points:
        """Echoes (N, 2) in the map, from the `start`-th on."""
        rows = self._echoes.rows(start)
        return in_map(rows, self._graph.poses)[0] if len(rows) else np.zeros((0, 2))

    @property
    def wall_count(self) -> int:
        return self._echoes.count

    def draw(self) -> None:
        """Bring the grid up to the newest echoes and rays, unless it is just being drawn anew."""
        if self._frames and self._drawing is None:
            self._drawn = self._draw_into(self.grid, self._drawn, self._rays.count)

    def _draw_on(self) -> None:
        """A part of the new grid after a correction; the old one stays until the new one is complete."""
        if self._drawing is None:
            return
        grid, drawn = self._drawing
        drawn = self._draw_into(grid, drawn, drawn[1] + REDRAW_ROWS)
        self._drawing = (grid, drawn)
        if drawn[1] == self._rays.count:
            self.grid, self._drawn, self._drawing = grid, drawn, None

    def _draw_into(self, grid: OccupancyGrid, drawn: tuple[int, int], ray_end: int) -> tuple[int, int]:
        """Echoes and rays from `drawn` (echoes, rays) on into a grid; returns how far it got."""
        grid.add_walls(self.wall_points(drawn[0]))
        rows = self._rays.rows(drawn[1])[: max(ray_end - drawn[1], 0)]
        here = self.pose
        grid.add_hull(np.array([(here.x_m, here.y_m)]))
        if len(rows):
            starts, directions = in_map(rows, self._graph.poses)
            grid.add_hull(starts[::5])
            grid.add_rays(starts, directions, rows[:, 5])
        return self._echoes.count, drawn[1] + len(rows)

    def _redraw(self) -> None:
        self._drawing = (OccupancyGrid(), (0, 0))
        self.revision += 1

    def _new_key_frame_due(self, pose: Pose2) -> bool:
        if not self._frames:
            return True
        last = self._frames[-1].odom
        return (
            last.distance_m(pose) >= KEY_FRAME_M or abs(wrap_angle(pose.heading_rad - last.heading_rad)) > KEY_FRAME_RAD
        )

    def _add_key_frame(self, t_s: float, odom: Pose2) -> None:
        if not self._frames:
            self._frames.append(KeyFrame(t_s, odom, self._travel_m))
            self._graph.add_node(Pose2(0.0, 0.0, 0.0))
            return
        last = self._frames[-1]
        relative = last.odom.between(odom)
        node = self._graph.add_node(self._graph.pose(len(self._frames) - 1).compose(relative))
        distance_m = hypot(relative.x_m, relative.y_m)
        along_sd = 0.003 + 0.01 * distance_m**0.5
        heading_sd = radians(0.05) + radians(0.02) * (t_s - last.t_s) ** 0.5 + 0.003 * abs(relative.heading_rad)
        information = np.diag([along_sd**-2, (0.003 + 0.005 * distance_m) ** -2, heading_sd**-2])
        self._graph.edges.append(Edge(node - 1, node, relative, information, closure=False))
        self._frames.append(KeyFrame(t_s, odom, self._travel_m))

    def _store(self, echoes: list[Echo], rays: list[Ray]) -> None:
        for echo in echoes:
            self._keep(self._echoes, echo.t_s, (echo.x_m, echo.y_m), echo.direction_rad, echo.range_m)
        for ray in rays:
            direction_rad = ray.pose.heading_rad + ray.bearing_rad
            self._keep(self._rays, ray.t_s, (ray.pose.x_m, ray.pose.y_m), direction_rad, ray.free_m)

    def _keep(
        self, store: FrameStore, t_s: float, place: tuple[float, float], direction_rad: float, length_m: float
    ) -> None:
        """Put something known in `odom` into the frame of the key frame of its time."""
        node = self._frame_at(t_s)
        frame = self._frames[node]
        x_m, y_m = frame.odom.inverse().transform(place)
        turned_rad = wrap_angle(direction_rad - frame.odom.heading_rad)
        store.add(node, frame.travel_m, float(x_m), float(y_m), turned_rad, length_m)

    def _frame_at(self, t_s: float) -> int:
        for node in range(len(self._frames) - 1, 0, -1):
            if self._frames[node].t_s <= t_s:
                return node
        return 0

    def _tie(self) -> None:
        """Look for ties of the recent stretch to what is known, and let the graph come to rest."""
        before = len(self._graph.edges)
        self._tie_walls()
        self._tie_loops()
        if len(self._graph.edges) == before:
            return
        self._last_closure_m = self._travel_m
        if self._graph.strain(before) > STRAIN_MAX and self._graph.optimise() > REDRAW_M:
            self._redraw()

    def _tie_walls(self) -> None:
        rows = self._echoes.stretch(self._travel_m - PIECE_TRAVEL_M)
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
            self._keep_right_angles(node, pose, normal_rad, length_m)
            local = pose.inverse().transform(middle)
            self._pieces.append(
                WallPiece(
                    node,
                    self._travel_m,
                    float(local[0]),
                    float(local[1]),
                    wrap_angle(normal_rad - pose.heading_rad),
                    length_m,
                )
            )

    def _continue_wall(
        self, node: int, pose: Pose2, middle: FloatArray, normal_rad: float, length_m: float, poses: FloatArray
    ) -> None:
        """Tie the piece to the earliest one of the same wall in the stretch looked back over."""
        for other in self._pieces:
            behind_m = self._travel_m - other.travel_m
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
            self._graph.edges.append(Edge(other.node, node, relative, information, closure=True))
            return

    def _keep_right_angles(self, node: int, pose: Pose2, normal_rad: float, length_m: float) -> None:
        """Where the walls so far stand at right angles, a piece that nearly does too pulls the heading, softly."""
        total_m = self._directions_m
        self._directions += length_m * rect(1.0, 4 * normal_rad)
        self._directions_m += length_m
        if total_m < RIGHT_ANGLES_WALL_M or abs(self._directions) < RIGHT_ANGLES_SHARE * self._directions_m:
            return
        off_rad = (4 * normal_rad - phase(self._directions) + pi) % (2 * pi) - pi
        if abs(off_rad / 4) > RIGHT_ANGLES_NEAR_RAD:
            return
        information = np.diag([0.0, 0.0, RIGHT_ANGLES_SD_RAD**-2])
        upright = Pose2(pose.x_m, pose.y_m, wrap_angle(pose.heading_rad - off_rad / 4))
        self._graph.edges.append(Edge(0, node, upright, information, closure=True))

    def _tie_loops(self) -> None:
        rows = self._echoes.stretch(self._travel_m - RECENT_M)
        if len(rows) < LOOP_POINTS_MIN:
            return
        poses = self._graph.poses
        here = self.pose
        old = np.array([f.travel_m for f in self._frames]) < self._travel_m - RECENT_M - LOOP_GAP_M
        near = np.hypot(poses[:, 0] - here.x_m, poses[:, 1] - here.y_m)
        near[~old] = np.inf
        points, directions = in_map(rows, poses)
        normals = np.stack([np.cos(directions), np.sin(directions)], axis=1)
        middle_node = int(np.median(rows[:, 0]))
        travels = np.array([f.travel_m for f in self._frames])
        for _ in range(PASSES_MAX):
            reachable = np.flatnonzero(near < LOOP_REACH_M)
            if not len(reachable):
                return
            first = travels[reachable[0]]
            of_pass = reachable[travels[reachable] < first + 2 * LOOP_REACH_M]
            self._match_pass(int(of_pass[near[of_pass].argmin()]), middle_node, points, normals, poses)
            near[travels < first + 2 * LOOP_SPAN_M] = np.inf

    def _match_pass(self, node: int, mine: int, points: Points, normals: Points, poses: FloatArray) -> None:
        travel_m = self._frames[node].travel_m
        end_m = min(travel_m + LOOP_SPAN_M, self._travel_m - RECENT_M - 2.0)
        rows = self._echoes.stretch(travel_m - LOOP_SPAN_M, end_m)
        if len(rows) < LOOP_POINTS_MIN:
            return
        fixed, directions = in_map(rows, poses)
        fixed_normals = np.stack([np.cos(directions), np.sin(directions)], axis=1)
        search_m = min(0.5 + 0.01 * (self._travel_m - self._last_loop_m), 2.0)
        centre = poses[mine, :2]
        match = register(points, normals, fixed, fixed_normals, centre, search_m, 0.04 + 0.04 * search_m)
        if (
            match is None
            or match.overlap < LOOP_OVERLAP_MIN
            or match.rms_m > LOOP_RMS_MAX_M
            or match.overlap * len(points) < LOOP_POINTS_MIN
            or (search_m > 0.8 and match.rival > 0.97)
        ):
            return
        self.closures += 1
        self._last_loop_m = self._travel_m
        corrected = _about(centre, match.correction).compose(Pose2.from_array(poses[mine]))
        reference = Pose2.from_array(poses[node])
        turn = Pose2(0.0, 0.0, -reference.heading_rad)
        rotation = np.eye(3)
        rotation[:2, :2] = np.stack([turn.transform([1.0, 0.0]), turn.transform([0.0, 1.0])], axis=1)
        information = rotation @ limited(match.information) @ rotation.T
        self._graph.edges.append(Edge(node, mine, reference.between(corrected), information, closure=True))


def limited(information: FloatArray) -> FloatArray:
    """No match is trusted further than the sonars' own systematic errors, in no direction."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    out = np.zeros((3, 3))
    out[:2, :2] = (vectors * np.minimum(values, LOOP_SD_M**-2)) @ vectors.T
    out[2, 2] = min(float(information[2, 2]), LOOP_SD_RAD**-2)
    return out


def _about(centre: FloatArray, motion: Pose2) -> Pose2:
    """A rotation about `centre` followed by a shift, as one motion of the map."""
    rotated = Pose2(0.0, 0.0, motion.heading_rad).transform(centre)
    return Pose2(
        float(centre[0] - rotated[0]) + motion.x_m, float(centre[1] - rotated[1]) + motion.y_m, motion.heading_rad
    )
