"""Simultaneous localisation and mapping from a few fixed beams: the mapping unit without its messages.

The front end, in every step:
1. Odometry filter: pose in `odom`, continuous.
2. Surroundings: ranges -> echoes on walls with normals, and free rays.
3. Key frames every 0.4 m hold their echoes and rays.
Every half metre it hands what is new to the back end, which runs beside it (`worker`), and takes its corrections over
as they come; grid and wall points are drawn from the key frames as they lie now.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, pi, radians

import numpy as np

from common.constants import SONAR_BEARINGS_RAD, SONAR_STEP_M, TICK_M, WHEEL_TRACK_M
from common.geometry import FloatArray, Points, Pose2, wrap_angle
from common.messages import Odometry, Ranges
from onboard.mmu.back_end.worker import Worker
from onboard.mmu.front_end.odometry import OdometryFilter, board_pose
from onboard.mmu.front_end.range_features import BEAM_HALF_RAD, Echo, Ray, Surroundings
from onboard.mmu.map.keyframes import Correction, FrameStore, Increment, KeyFrame, LastSeen, PoseStore, in_map
from onboard.mmu.map.map_file import SavedMap
from onboard.mmu.map.occupancy import OccupancyGrid
from onboard.mmu.map.wall_points import WallPoints, WallStore

KEY_FRAME_M = 0.4
KEY_FRAME_RAD = 0.35
WAY_M_PER_RAD = 0.6  # a robot that turns on the spot sees as much new as one that drives so far
HAND_OVER_M = 0.5
POSES_KEPT = 60  # of recent odometry, for dating ranges
SD_MAX_M = 2.5
# What a step takes in at most of what a map from before holds, or a correction left over: it must stay short
DRAW_RAYS = 40
DRAW_ECHOES = 1000
PLACE_ECHOES = 4000


@dataclass(frozen=True, slots=True)
class Carrier:
    """What the mapping unit must know of whatever carries it."""

    bearings_rad: tuple[float, ...] = SONAR_BEARINGS_RAD
    range_step_m: float = SONAR_STEP_M
    beam_half_rad: float = BEAM_HALF_RAD
    spacing_m: float = 0.0  # the usual way between two ranges of a beam, where it is long
    tick_m: float = TICK_M
    track_m: float = WHEEL_TRACK_M


ROBOT = Carrier()


class Slam:
    """The whole of it. `add_odometry` and `add_ranges` take the reports in as they come; the rest is read off."""

    def __init__(self, worker: Worker, carrier: Carrier = ROBOT, saved: SavedMap | None = None) -> None:
        """`worker`: where the back end runs; `saved`: a map from before, to go on in."""
        self._odometry = OdometryFilter(carrier.track_m, carrier.tick_m)
        self._listen = partial(
            Surroundings, carrier.bearings_rad, carrier.range_step_m, carrier.beam_half_rad, carrier.spacing_m
        )
        self._surroundings = self._listen()
        self._worker = worker
        self._beams = len(carrier.bearings_rad)
        self._recent: list[tuple[float, Pose2]] = []
        self._frames: list[KeyFrame] = []
        self._poses = PoseStore()
        self._echoes = FrameStore()
        self._rays = FrameStore()
        self._approaches: list[tuple[float, ...]] = []  # that the back end does not have
        self._travel_m = self._way_m = 0.0
        self._handed = (0, 0, 0)  # frames, echoes and rays that the back end has
        self._submitted = (0, 0)  # echoes and rays that the next correction rests on
        self._known = self._known_echoes = self._known_rays = 0  # of a map from before
        self._known_way_m = 0.0
        self._handed_m = 0.0
        self._drawn = (0, 0)  # echoes and rays in the grid
        self._walls = WallStore()
        self._placed = 0  # echoes among the wall points
        self.grid = OccupancyGrid()
        self.revision = 0
        self.closures = 0
        self._tied_at_m = 0.0
        self._saved = saved
        self._lost = False
        self._board: Odometry | None = None
        if saved is not None:
            self._restore(saved)

    @property
    def pose(self) -> Pose2:
        """Where the robot is in the map."""
        if not self._frames:
            return Pose2(0.0, 0.0, 0.0)
        return self._poses.last.compose(self._frames[-1].odom.between(self._odometry.pose))

    @property
    def travel_m(self) -> float:
        return self._travel_m

    @property
    def uncertainty(self) -> tuple[float, float]:
        """Standard deviations of position (metres) and heading (radians) since the last tie to known walls."""
        since_m = self._way_m - self._tied_at_m
        if self._lost:
            return inf, pi
        return min(0.03 + 0.01 * since_m, SD_MAX_M), radians(0.3) + radians(0.05) * since_m

    @property
    def anchored_pose(self) -> tuple[int, Pose2]:
        """The newest key frame, and the robot as seen from it: what makes a smoothed path of the corrected ones."""
        return len(self._frames) - 1, self._frames[-1].odom.between(self._odometry.pose)

    def add_odometry(self, odometry: Odometry) -> bool:
        """Take in one report. False: it did not go on from the one before (the board restarted or jumped)."""
        if self._board is None and self._saved is not None and isfinite(odometry.t_s):
            self._find_way_in(self._saved, odometry)
        goes_on = self._odometry.update(odometry)
        if goes_on or self._board is None or odometry.session != self._board.session:
            self._board = odometry
            self._go_on(odometry.t_s)
        return goes_on

    def add_motion(self, t_s: float, moved: Pose2, certain: bool = True) -> None:
        """Like `add_odometry`, for a carrier that knows its own pose only: where it is, as seen from where it was.

        `certain` false: `moved` is a guess, and what is heard from now on no run with what was heard before.
        """
        self._odometry.move(moved)
        if not certain:
            self._odometry.carried = True
            self._recent.clear()
            self._surroundings = self._listen()
        self._go_on(t_s)

    def _go_on(self, t_s: float) -> None:
        pose = self._odometry.pose
        if self._recent:
            last = self._recent[-1][1]
            driven_m = last.distance_m(pose)
            self._travel_m += driven_m
            self._way_m += driven_m + WAY_M_PER_RAD * abs(wrap_angle(pose.heading_rad - last.heading_rad))
        self._recent.append((t_s, pose))
        del self._recent[:-POSES_KEPT]
        if self._new_key_frame_due(pose):
            self._add_key_frame(t_s, pose)
        correction = self._worker.collect(t_s)
        if correction is not None:
            self._correct(correction)
        if self._way_m - self._handed_m >= HAND_OVER_M and not self._worker.busy:
            self._hand_over(t_s)
        if self._frames:
            self._draw()

    def close(self) -> None:
        self._worker.close()

    def add_ranges(self, ranges: Ranges) -> None:
        """Take in one report; ranges from before the first odometry are of no use, nor those of other sonars."""
        if self._recent and len(ranges.range_m) == len(ranges.age_s) == self._beams:
            self._store(*self._surroundings.add(ranges.t_s, self._recent, ranges.range_m, ranges.age_s))
            for approach in self._surroundings.take_approaches():
                far = self._in_frame(approach.far_t_s, (approach.far.x_m, approach.far.y_m))
                near = self._in_frame(approach.near_t_s, (approach.near.x_m, approach.near.y_m))
                self._approaches.append((*far, *near, approach.closer_m, approach.left_m))

    def trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Times (K,) and poses (K, 3) of the key frames as they lie now."""
        return np.array([f.t_s for f in self._frames]), self._poses.array.copy()

    def wall_points(self) -> Points:
        """Echoes (N, 2) in the map as they lie now."""
        return in_map(self._echoes.rows(), self._poses.array)[0]

    def map_points(self, start: int) -> WallPoints:
        """The map's wall points from the `start`-th on; those of a revision lie where they lay when they came."""
        rows = self._echoes.rows(self._placed, self._placed + PLACE_ECHOES)
        self._walls.append(WallPoints.of(in_map(rows, self._poses.array)[0], np.zeros((0, 2))))
        self._placed += len(rows)
        return self._walls.since(start)

    @property
    def map_count(self) -> int:
        """How many wall points the map has, with those that `map_points` has not placed yet."""
        return len(self._walls) + len(self._echoes) - self._placed

    def _draw(self) -> None:
        """Bring the grid up to the newest echoes and rays."""
        echoes = self._echoes.rows(self._drawn[0], self._drawn[0] + DRAW_ECHOES)
        if len(echoes):
            self.grid.add_walls(*in_map(echoes, self._poses.array))
        rays = self._rays.rows(self._drawn[1], self._drawn[1] + DRAW_RAYS)
        if len(rays):
            starts, directions = in_map(rays, self._poses.array)
            self.grid.add_rays(starts, directions, rays[:, 5])
            self.grid.add_footprint(starts)
        self._drawn = self._drawn[0] + len(echoes), self._drawn[1] + len(rays)

    def _new_key_frame_due(self, pose: Pose2) -> bool:
        if not self._frames or self._odometry.carried or len(self._frames) == self._known:
            return True
        last = self._frames[-1].odom
        return (
            last.distance_m(pose) >= KEY_FRAME_M or abs(wrap_angle(pose.heading_rad - last.heading_rad)) > KEY_FRAME_RAD
        )

    def _add_key_frame(self, t_s: float, odom: Pose2) -> None:
        if not self._frames:
            self._poses.append(Pose2(0.0, 0.0, 0.0))
        else:
            self._poses.append(self._poses.last.compose(self._frames[-1].odom.between(odom)))
        turned_rad, calibrated_rad = self._odometry.turned_rad, self._odometry.calibrated_rad
        certain = not self._odometry.carried
        if not certain:
            self._odometry.carried, self._lost, self._known_way_m = False, True, self._way_m
        slip = self._odometry.slip.along_m_per_sqrt_m
        self._frames.append(KeyFrame(t_s, odom, self._travel_m, self._way_m, turned_rad, calibrated_rad, certain, slip))

    def _hand_over(self, t_s: float) -> None:
        self._handed_m = self._way_m
        if self._handed[0] < self._known:  # the map from before, as it was
            increment = self._increment(self._handed, (self._known, self._known_echoes, self._known_rays), known=True)
        else:
            increment = self._increment(self._handed, (len(self._frames), len(self._echoes), len(self._rays)))
        self._worker.submit(increment, t_s)

    def _increment(self, start: tuple[int, int, int], end: tuple[int, int, int], known: bool = False) -> Increment:
        self._handed, self._submitted = end, end[1:]
        last = self._board
        approaches, self._approaches = ([], self._approaches) if known else (self._approaches, [])
        return Increment(
            tuple(self._frames[start[0] : end[0]]),
            self._echoes.rows(start[1], end[1]),
            self._rays.rows(start[2], end[2]),
            None if last is None else LastSeen(last.session, board_pose(last), self.pose),
            known,
            np.array(approaches).reshape(-1, 8),
        )

    def _correct(self, correction: Correction) -> None:
        """Take over where the key frames lie; those that are newer follow the last of them."""
        known = len(correction.poses)
        if known == 0:
            self._begin_back_end_anew()
            return
        self._poses.correct(correction.poses)
        self._odometry.calibrate(*correction.drift)
        self.closures, self._tied_at_m = correction.closures, correction.tied_at_m
        if self._lost and correction.tied_at_m > self._known_way_m:
            self._lost = False
        if correction.grid is not None:
            self.grid, self._drawn = correction.grid, self._submitted
        if correction.walls is not None:
            self._walls.begin_anew(correction.walls)
            self._placed = self._submitted[0]
            self.revision += 1

    def _restore(self, saved: SavedMap) -> None:
        self._frames = list(saved.frames())
        self._poses.correct(saved.poses)
        self._echoes.append(saved.echoes)
        self._rays.append(saved.rays)
        if self._frames:
            self._travel_m, self._way_m = self._frames[-1].travel_m, self._frames[-1].way_m
            self._odometry.begin_at(self._frames[-1].odom)
        self._set_known()
        self._handed_m = -inf

    def _begin_back_end_anew(self) -> None:
        """All that is known becomes a map from before, as it lies now."""
        now = self.pose
        ways_m = np.array([f.way_m for f in self._frames])
        saved = SavedMap(self.trajectory()[0], self._poses.array.copy(), ways_m, np.zeros((0, 6)), np.zeros((0, 6)))
        self._frames = list(saved.frames())
        self._odometry.begin_at(now)
        self._set_known()
        self._handed, self._handed_m = (0, 0, 0), -inf

    def _set_known(self) -> None:
        self._known, self._known_echoes, self._known_rays = len(self._frames), len(self._echoes), len(self._rays)
        self._known_way_m = self._way_m

    def _find_way_in(self, saved: SavedMap, odometry: Odometry) -> None:
        """Where the robot is now in the map from before: the board counted on while this process was away."""
        last = saved.last
        if last is not None and last.session == odometry.session:
            self._odometry.begin_at(last.pose.compose(last.board.between(board_pose(odometry))))
            return
        if last is not None:
            self._odometry.begin_at(last.pose)
        self._odometry.carried = True

    def _store(self, echoes: list[Echo], rays: list[Ray]) -> None:
        for echo in echoes:
            self._keep(self._echoes, echo.t_s, (echo.x_m, echo.y_m), echo.normal_rad, echo.range_m)
        for ray in rays:
            direction_rad = ray.pose.heading_rad + ray.bearing_rad
            self._keep(self._rays, ray.t_s, (ray.pose.x_m, ray.pose.y_m), direction_rad, ray.free_m)

    def _keep(
        self, store: FrameStore, t_s: float, place: tuple[float, float], direction_rad: float, length_m: float
    ) -> None:
        """Put something known in `odom` into the frame of the key frame of its time."""
        node, x_m, y_m = self._in_frame(t_s, place)
        frame = self._frames[node]
        turned_rad = wrap_angle(direction_rad - frame.odom.heading_rad)
        store.append(np.array([[node, frame.way_m, x_m, y_m, turned_rad, length_m]]))

    def _in_frame(self, t_s: float, place: tuple[float, float]) -> tuple[int, float, float]:
        """A place (odom) in the frame of the key frame of its time: key frame, x and y."""
        node = self._frame_at(t_s)
        x_m, y_m = self._frames[node].odom.inverse().transform(place)
        return node, float(x_m), float(y_m)

    def _frame_at(self, t_s: float) -> int:
        for node in range(len(self._frames) - 1, 0, -1):
            if self._frames[node].t_s <= t_s:
                return node
        return 0
