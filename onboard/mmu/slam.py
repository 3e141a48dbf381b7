"""Simultaneous localisation and mapping from a few fixed beams: the mapping unit without its messages.

In every step, the front end
1. predicts the pose in `odom` from odometry (`dead_reckoning`),
2. extracts features from the ranges: echoes on walls with their normals, free rays, ranges to a wall ahead
   (`range_features`), and stores them relative to a keyframe every 0.4 m (`keyframe_map`),
3. hands what is new over to the back end, which runs beside the steps, and takes its corrections (`back_end_link`),
4. keeps the published map up (`drawn_map`), which draws the newest observations when it is asked for.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from math import isfinite

from common.constants import SONAR_BEARINGS_RAD, SONAR_STEP_M, TICK_M, WHEEL_TRACK_M
from common.geometry import FloatArray, Points, Pose2, wrap_angle
from common.messages.motion import Odometry, Ranges
from onboard.mmu.back_end.back_end_link import BackEndLink, BackEndWorker
from onboard.mmu.back_end.exchange import Correction
from onboard.mmu.front_end.dead_reckoning import DeadReckoning
from onboard.mmu.front_end.localisation import Localisation, Uncertainty
from onboard.mmu.front_end.odometry import board_pose
from onboard.mmu.front_end.range_features import BEAM_HALF_RAD, RangeFeatures
from onboard.mmu.front_end.stated_pose import SD_MIN_M, SD_MIN_RAD, Beams, Verdict, judge
from onboard.mmu.map.drawn_map import DrawnMap
from onboard.mmu.map.keyframe_map import KeyframeMap
from onboard.mmu.map.keyframes import Keyframe, LastSeen, StatedPose
from onboard.mmu.map.map_file import SavedMap

# A keyframe for so much driving or turning. The sensitivity was not measured
KEYFRAME_M = 0.4
KEYFRAME_RAD = 0.35

_log = logging.getLogger("mmu")


@dataclass(frozen=True, slots=True)
class Carrier:
    """What the mapping unit must know of the robot that carries it."""

    bearings_rad: tuple[float, ...] = SONAR_BEARINGS_RAD
    range_step_m: float = SONAR_STEP_M
    beam_half_rad: float = BEAM_HALF_RAD
    spacing_m: float = 0.0  # the usual path between two ranges of a beam, where it is long
    tick_m: float = TICK_M
    track_m: float = WHEEL_TRACK_M

    def range_features(self) -> RangeFeatures:
        """Of its beams, with nothing received yet."""
        return RangeFeatures(self.bearings_rad, self.range_step_m, self.beam_half_rad, self.spacing_m)


ROBOT = Carrier()


class Slam:
    """`add_odometry` and `add_ranges` take the reports in as they come; the properties are the estimates."""

    def __init__(self, worker: BackEndWorker, carrier: Carrier = ROBOT, saved: SavedMap | None = None) -> None:
        """`worker`: where the back end runs; `saved`: a prior map, to continue in."""
        self._carrier = carrier
        self._odometry = DeadReckoning(carrier.track_m, carrier.tick_m)
        self._features = carrier.range_features()
        self._keyframes = KeyframeMap()
        self._drawn = DrawnMap(self._keyframes)
        self._back_end = BackEndLink(worker, self._keyframes)
        self._localisation = Localisation()
        self._prior_map = saved
        self.closures = 0
        if saved is not None:
            self._keyframes.load(saved)
            self._continue_from_prior_map()

    # Estimates

    @property
    def pose(self) -> Pose2:
        """Where the robot is in the map."""
        return self._keyframes.pose_of(self._odometry.pose)

    @property
    def uncertainty(self) -> Uncertainty:
        return self._localisation.uncertainty(self._odometry.path_m)

    @property
    def travel_m(self) -> float:
        return self._odometry.travel_m

    @property
    def anchored_pose(self) -> tuple[int, Pose2]:
        """The newest keyframe, and the robot as seen from it; a smoothed path follows from the corrected keyframes."""
        return len(self._keyframes.keyframes) - 1, self._keyframes.from_newest(self._odometry.pose)

    @property
    def map(self) -> DrawnMap:
        """As it is published."""
        return self._drawn

    def trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Times (K,) and poses (K, 3) of the keyframes as they lie now."""
        return self._keyframes.trajectory()

    def wall_points(self) -> Points:
        """Echoes (N, 2) in the map as they lie now."""
        return self._keyframes.wall_points()

    # Reports

    def add_odometry(self, odometry: Odometry) -> bool:
        """Takes one report in. False: it does not continue the one before (the board restarted or jumped)."""
        if self._odometry.board is None and self._prior_map is not None and isfinite(odometry.t_s):
            self._localise_in(self._prior_map, odometry)
        continues, advances = self._odometry.update(odometry)
        if advances:
            self._step(odometry.t_s)
        return continues

    def add_motion(self, t_s: float, moved: Pose2, certain: bool = True) -> None:
        """Like `add_odometry`, for a carrier that only knows its own pose: where it is, as seen from where it was.

        `certain` false: `moved` is a guess, and no range received from now on continues the earlier ones.
        """
        self._odometry.move(moved, certain)
        if not certain:
            self._features = self._carrier.range_features()
        self._step(t_s)

    def add_ranges(self, ranges: Ranges) -> None:
        """Takes one report in; ranges from before the first odometry are of no use, nor those of other sonars."""
        recent = self._odometry.recent
        if not recent or not len(ranges.range_m) == len(ranges.age_s) == len(self._carrier.bearings_rad):
            return
        keyframes = self._keyframes
        echoes, rays = self._features.add(ranges.t_s, recent, ranges.range_m, ranges.age_s)
        for echo in echoes:
            keyframes.add_echo(echo.t_s, (echo.x_m, echo.y_m), echo.normal_rad, echo.range_m)
        for ray in rays:
            keyframes.add_ray(ray.t_s, ray.pose, ray.bearing_rad, ray.free_m)
        for wall in self._features.take_ranges_to_wall():
            far = keyframes.in_keyframe(wall.far_t_s, (wall.far.x_m, wall.far.y_m))
            near = keyframes.in_keyframe(wall.near_t_s, (wall.near.x_m, wall.near.y_m))
            self._back_end.add_range_to_wall((*far, *near, wall.closer_m, wall.left_m))

    def place(self, t_s: float, pose: Pose2, sd_m: float, sd_rad: float, ranges_m: tuple[float, ...]) -> Verdict:
        """A person says that the robot, which stands, is at that pose in the map; `ranges_m`: what it measures there.

        Unless it is refused, the robot counts as carried there.
        """
        keyframes = self._keyframes
        anchor, apart_m = keyframes.nearest(pose)
        present = None if self._localisation.kidnapped else self.pose
        beams = Beams(ranges_m, self._carrier.bearings_rad, self._carrier.beam_half_rad)
        sd_m, sd_rad = max(sd_m, SD_MIN_M), max(sd_rad, SD_MIN_RAD)
        verdict = judge(pose, sd_m, sd_rad, present, apart_m, beams, keyframes.wall_points())
        if not verdict.refused:
            seen = Pose2.from_array(keyframes.poses.array[anchor]).between(pose)
            self._odometry.place(keyframes.odom_of(pose))
            self._odometry.advance(t_s)
            self._features = self._carrier.range_features()
            self._add_keyframe(t_s, StatedPose(anchor, seen, sd_m, sd_rad))
        return verdict

    def close(self) -> None:
        self._back_end.close()

    def _step(self, t_s: float) -> None:
        self._odometry.advance(t_s)
        if self._keyframe_due():
            self._add_keyframe(t_s)
        correction = self._back_end.collect(t_s)
        if correction is not None:
            self._correct(correction)
        if self._back_end.due(self._odometry.path_m):
            self._back_end.hand_over(t_s, self._odometry.path_m, self._last_seen())
        self._drawn.keep_up()

    # Keyframes

    def _keyframe_due(self) -> bool:
        count, kidnapped = len(self._keyframes.keyframes), self._odometry.filter.kidnapped
        if count == self._back_end.prior.keyframes or kidnapped:
            return True
        last, pose = self._keyframes.keyframes[-1].odom, self._odometry.pose
        turned_rad = abs(wrap_angle(pose.heading_rad - last.heading_rad))
        return last.distance_m(pose) >= KEYFRAME_M or turned_rad > KEYFRAME_RAD

    def _add_keyframe(self, t_s: float, stated: StatedPose | None = None) -> None:
        odometry, motion = self._odometry.filter, self._odometry
        certain = not odometry.kidnapped
        odometry.kidnapped = False
        if stated is not None:
            self._localisation.place(motion.path_m, len(self._keyframes.keyframes), stated.sd_m, stated.sd_rad)
        elif not certain:
            self._localisation.kidnap(motion.path_m)
        turned_rad, calibrated_rad = odometry.turned_rad, odometry.calibrated_rad
        slip = odometry.slip.along_m_per_sqrt_m
        self._keyframes.add(
            Keyframe(
                t_s, motion.pose, motion.travel_m, motion.path_m, turned_rad, calibrated_rad, certain, slip, stated
            )
        )

    # Corrections by the back end

    def _correct(self, correction: Correction) -> None:
        """Take over where the keyframes lie; those that are newer follow the last of them."""
        for line in correction.log_lines:
            _log.info("%s", line)
        if not len(correction.poses):
            self._begin_back_end_again()
            return
        self._keyframes.poses.correct(correction.poses)
        self._odometry.filter.calibrate(correction.drift_rad_per_m, correction.turn_scale_error)
        self.closures = correction.closures
        newest = len(correction.poses) - 1
        path_m = self._keyframes.keyframes[newest].path_m
        self._localisation.correct(correction.covariance, newest, path_m, correction.closure_path_m)
        self._drawn.replace(correction.grid, correction.walls, self._back_end.submitted)

    def _last_seen(self) -> LastSeen | None:
        board = self._odometry.board
        return None if board is None else LastSeen(board.session, board_pose(board), self.pose)

    # Prior maps

    def _continue_from_prior_map(self) -> None:
        if self._keyframes.keyframes:
            last = self._keyframes.keyframes[-1]
            self._odometry.continue_from(last.odom, last.travel_m, last.path_m)
        self._begin_back_end()

    def _begin_back_end_again(self) -> None:
        """It was lost: all that is known becomes a prior map, as it lies now."""
        now = self.pose
        self._keyframes.freeze()
        self._odometry.filter.begin_at(now)
        self._begin_back_end()

    def _begin_back_end(self) -> None:
        self._back_end.begin_with_prior()
        self._localisation.begin_at(self._odometry.path_m)

    def _localise_in(self, saved: SavedMap, odometry: Odometry) -> None:
        """Where the robot is now in the prior map: the board kept counting while this process was away."""
        last, motion = saved.last, self._odometry.filter
        if last is not None and last.session == odometry.session:
            motion.begin_at(last.pose.compose(last.board.between(board_pose(odometry))))
            return
        if last is not None:
            motion.begin_at(last.pose)
        motion.kidnapped = True
