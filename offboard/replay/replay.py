"""The mapping unit alone over a range log (`range_log`) -> trajectories and map points in a folder.

The very code that runs on the robot, whatever carried the sensors: odometry comes as poses, beams in any number.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import isinf, radians
from pathlib import Path

import numpy as np

from common.errors import StartError
from common.geometry import FloatArray, Pose2
from common.messages.motion import Ranges
from offboard.replay.range_log import RangeLog
from offboard.runs.run_folder import MAP_POINTS_NAME, SMOOTHED_NAME, TRAJECTORY_NAME, write_map_points, write_tum
from onboard.mmu.back_end.map_builder import deferred_back_end
from onboard.mmu.slam import Carrier, Slam

Watcher = Callable[[float, Slam], None]
BEAM_HALF_WIDTH_DEG = 4.0  # of a log without one: a laser's beam is narrower, a small sonar's wider


@dataclass(frozen=True, slots=True)
class Replayed:
    """Poses (N, 3) at the log's times, as estimated then and in the end; map points (M, 2); cost of each scan (N,).

    `loose`: with which scans pieces of odometry begin that were not recognised in the map from before.
    """

    times_s: FloatArray
    online: FloatArray
    smoothed: FloatArray
    points: FloatArray
    step_s: FloatArray
    work_s: FloatArray  # of the back end, which runs beside the steps
    closures: int
    loose: tuple[int, ...]


def replay(log: RangeLog, beam_half_width_deg: float = BEAM_HALF_WIDTH_DEG, watch: Watcher | None = None) -> Replayed:
    """The whole log through the mapping unit. `watch` is given every scan's time and the mapping unit after it."""
    worker = deferred_back_end(gyro_led=False)
    slam = Slam(worker, Carrier(log.bearings_rad, log.range_step_m, radians(beam_half_width_deg), spacing_m=log.step_m))
    count = len(log.times_s)
    online, step_s, work_s = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    anchored: list[tuple[int, Pose2]] = []
    begun: list[int] = []
    loose: list[int] = []
    of_beams = _shifted(log.poses, log.centre_m)
    last = Pose2.from_array(of_beams[0])
    ages_s = (0.0,) * len(log.bearings_rad)
    for i, (t_s, pose, ranges_m) in enumerate(zip(log.times_s.tolist(), of_beams, log.ranges_m.tolist(), strict=True)):
        here = Pose2.from_array(pose)
        if not log.goes_on[i]:
            loose += _unrecognised(slam, begun)
            begun.append(i)
        began = time.thread_time()
        slam.add_motion(t_s, last.between(here), bool(log.goes_on[i]))
        slam.add_ranges(Ranges(t_s, tuple(ranges_m), ages_s))
        step_s[i] = time.thread_time() - began
        online[i] = slam.pose.as_array()
        anchored.append(slam.anchored_pose)
        last = here
        began = time.thread_time()
        worker.work()
        work_s[i] = time.thread_time() - began
        if watch is not None:
            watch(t_s, slam)
    loose += _unrecognised(slam, begun)
    poses = slam.trajectory()[1]
    smoothed = np.array([Pose2.from_array(poses[node]).compose(seen).as_array() for node, seen in anchored])
    online, smoothed = (in_frame_of_log(path, log) for path in (online, smoothed))
    points = slam.wall_points() + log.centre_m
    return Replayed(log.times_s, online, smoothed, points, step_s, work_s, slam.closures, tuple(loose))


def in_frame_of_log(poses: FloatArray, log: RangeLog) -> FloatArray:
    """Poses (N, 3) of the beams' centre, from where that began -> of the carrier, from where the carrier did."""
    shifted: FloatArray = _shifted(poses, -log.centre_m) + np.array([*log.centre_m, 0.0])
    return shifted


def _shifted(poses: FloatArray, by_m: FloatArray) -> FloatArray:
    """Poses (N, 3) of what is `by_m` (2,) away, as seen from poses (N, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x_m, y_m = by_m
    return np.column_stack([poses[:, 0] + c * x_m - s * y_m, poses[:, 1] + s * x_m + c * y_m, poses[:, 2]])


def _unrecognised(slam: Slam, begun: list[int]) -> list[int]:
    """The newest of the pieces begun, if it is not connected to the map from before."""
    return begun[-1:] if isinf(slam.uncertainty.sd_m) else []


def write_replay(folder: Path, run: Replayed) -> None:
    """`trajectory.tum`, `trajectory_smoothed.tum`, `map_points.csv`; raises StartError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_tum(folder / TRAJECTORY_NAME, run.times_s, run.online)
        write_tum(folder / SMOOTHED_NAME, run.times_s, run.smoothed)
        write_map_points(folder / MAP_POINTS_NAME, run.points, np.zeros(len(run.points), np.uint8))
    except OSError as error:
        raise StartError(f"The folder {folder} cannot be written: {error.strerror}.") from error
