"""The map as the front end holds it: keyframes, their poses, and the echoes and rays observed from each."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from common.geometry import FloatArray, Points, Pose2, wrap_angle
from onboard.mmu.map.keyframes import Keyframe, ObservationStore, PoseStore, in_map
from onboard.mmu.map.map_file import SavedMap


class Counts(NamedTuple):
    """How many there are of each."""

    keyframes: int = 0
    echoes: int = 0
    rays: int = 0


class KeyframeMap:
    """Everything is stored relative to its keyframe, so that it moves with it when the back end corrects the poses."""

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self.poses = PoseStore()
        self.echoes = ObservationStore()
        self.rays = ObservationStore()

    @property
    def counts(self) -> Counts:
        return Counts(len(self.keyframes), len(self.echoes), len(self.rays))

    def load(self, saved: SavedMap) -> None:
        """A prior map."""
        self.keyframes = list(saved.keyframes())
        self.poses.correct(saved.poses)
        self.echoes.append(saved.echoes)
        self.rays.append(saved.rays)

    def freeze(self) -> None:
        """All that is known becomes a prior map, as it lies now."""
        times_s, poses = self.trajectory()
        paths_m = np.array([keyframe.path_m for keyframe in self.keyframes])
        self.keyframes = list(SavedMap(times_s, poses, paths_m, np.zeros((0, 6)), np.zeros((0, 6))).keyframes())

    def add(self, keyframe: Keyframe) -> None:
        """The first one lies at the map's zero, every other one where odometry puts it."""
        self.poses.append(self.pose_of(keyframe.odom))
        self.keyframes.append(keyframe)

    def pose_of(self, odom: Pose2) -> Pose2:
        """A pose of `odom` in the map, by the newest keyframe."""
        if not self.keyframes:
            return Pose2(0.0, 0.0, 0.0)
        return self.poses.last.compose(self.from_newest(odom))

    def nearest(self, place: Pose2) -> tuple[int, float]:
        """The keyframe nearest to a place in the map, and how far that is (m); infinitely far where there is none."""
        if not self.keyframes:
            return 0, inf
        apart_m = np.hypot(self.poses.array[:, 0] - place.x_m, self.poses.array[:, 1] - place.y_m)
        return int(apart_m.argmin()), float(apart_m.min())

    def odom_of(self, place: Pose2) -> Pose2:
        """A pose in the map in `odom`, by the newest keyframe."""
        return self.keyframes[-1].odom.compose(self.poses.last.between(place))

    def from_newest(self, odom: Pose2) -> Pose2:
        """A pose of `odom` as seen from the newest keyframe."""
        return self.keyframes[-1].odom.between(odom)

    def add_echo(self, t_s: float, place: tuple[float, float], normal_rad: float, range_m: float) -> None:
        """A place on a wall and the wall's normal there, both in `odom`."""
        self._add(self.echoes, t_s, place, normal_rad, range_m)

    def add_ray(self, t_s: float, pose: Pose2, bearing_rad: float, free_m: float) -> None:
        """Free space along a beam, from a pose in `odom`."""
        self._add(self.rays, t_s, (pose.x_m, pose.y_m), pose.heading_rad + bearing_rad, free_m)

    def in_keyframe(self, t_s: float, place: tuple[float, float]) -> tuple[int, float, float]:
        """A place (odom) relative to the keyframe of its time: keyframe, x and y."""
        node = self._keyframe_at(t_s)
        seen = self.keyframes[node].odom.between(Pose2(*place, 0.0))
        return node, seen.x_m, seen.y_m

    def trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Times (K,) and poses (K, 3) of the keyframes as they lie now."""
        return np.array([keyframe.t_s for keyframe in self.keyframes]), self.poses.array.copy()

    def wall_points(self) -> Points:
        """Echoes (N, 2) in the map as they lie now."""
        return in_map(self.echoes.rows(), self.poses.array)[0]

    def _add(
        self, store: ObservationStore, t_s: float, place: tuple[float, float], direction_rad: float, length_m: float
    ) -> None:
        node, x_m, y_m = self.in_keyframe(t_s, place)
        keyframe = self.keyframes[node]
        turned_rad = wrap_angle(direction_rad - keyframe.odom.heading_rad)
        store.append([[node, keyframe.path_m, x_m, y_m, turned_rad, length_m]])

    def _keyframe_at(self, t_s: float) -> int:
        for node in range(len(self.keyframes) - 1, 0, -1):
            if self.keyframes[node].t_s <= t_s:
                return node
        return 0
