"""Node `recorder`: pose, map, trajectory, plan, points of interest -> the run folder.

`trajectory.tum` grows with every pose; the rest is written every WRITE_PERIOD_S, when the mission finishes, and at the
end. What the disk refuses is kept and tried again: a full disk costs nothing but the warning.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from common.bus import Bus
from common.errors import ErrorCode
from common.messages import MAP, PLAN, POI, POSE, TRAJECTORY, MapUpdate, PlannerView, PointOfInterest, PoseEstimate
from common.messages import Trajectory as SmoothedTrajectory
from common.status import StatusReporter
from offboard.recorder import run_folder
from offboard.recorder.map_assembly import MapAssembly
from offboard.tools.export import export_run

WRITE_PERIOD_S = 10.0
EXPORT_FORMATS = ("svg", "png")

_log = logging.getLogger("recorder")


def poi_record(poi: PointOfInterest, photo: str) -> dict[str, Any]:
    """One entry of pois.json; `photo` is the picture's path inside the run folder, empty where there is none."""
    kept = ("poi_id", "name", "description", "x_m", "y_m", "number", "room_type", "confidence", "state", "t_s")
    return {name: getattr(poi, name) for name in kept} | {"photo": photo}


class Recorder:
    """Keeps a run. A folder that holds a run already is continued, not overwritten."""

    name = "recorder"
    period_s = 0.1

    def __init__(self, run_dir: Path) -> None:
        self.run_dir = run_dir
        self.finished = False
        self._status = StatusReporter(self.name)
        self._lines: run_folder.LineFile | None = None
        self._pending: list[str] = []
        self._newest_pose_s = float("-inf")
        self._map = MapAssembly()
        self._trajectory: SmoothedTrajectory | None = None
        self._pois = {record["poi_id"]: record for record in run_folder.read_pois(run_dir / run_folder.POIS_NAME)}
        self._photos: dict[str, bytes] = {}  # by name, until they are on the disk
        self._changed: set[str] = set()  # files that differ from what is here
        self._next_write_s: float | None = None
        self._disk_works = True

    def step(self, bus: Bus, now_s: float) -> None:
        for pose in bus.take(POSE):
            self._take_pose(pose)
        for update in bus.take(MAP):
            self._take_map(update)
        for trajectory in bus.take(TRAJECTORY):
            self._trajectory = trajectory
            self._changed.add(run_folder.SMOOTHED_NAME)
        for poi in bus.take(POI):
            self._take_poi(poi)
        if self._disk_works:
            self._on_disk(self._append_poses)
        ends = self._mission_ends(bus.take(PLAN))
        if self._next_write_s is None:
            self._next_write_s = now_s + WRITE_PERIOD_S
        if ends or now_s >= self._next_write_s:
            self._next_write_s = now_s + WRITE_PERIOD_S
            self._write(with_pictures=ends)
        self._report(bus, now_s)

    def close(self) -> None:
        """Write everything that is not on the disk yet, pictures of the map included."""
        self._write(with_pictures=True)
        if self._lines is not None:
            self._lines.close()
            self._lines = None

    def _take_pose(self, pose: PoseEstimate) -> None:
        in_order = pose.t_s > self._newest_pose_s
        if in_order and all(map(isfinite, (pose.x_m, pose.y_m, pose.heading_rad))):
            self._newest_pose_s = pose.t_s
            self._pending.append(run_folder.tum_line(pose.t_s, pose.x_m, pose.y_m, pose.heading_rad))

    def _take_map(self, update: MapUpdate) -> None:
        lost = self._map.add(update)
        if lost:
            _log.warning("map points were lost; the next whole map brings them points=%d", lost)
        self._changed.add(run_folder.MAP_POINTS_NAME)

    def _take_poi(self, poi: PointOfInterest) -> None:
        photo = self._pois.get(poi.poi_id, {}).get("photo", "")
        if poi.photo_jpeg:
            photo = f"{run_folder.PHOTO_FOLDER}/poi_{poi.poi_id}.jpg"
            self._photos[photo] = poi.photo_jpeg
        self._pois[poi.poi_id] = poi_record(poi, photo)
        self._changed.add(run_folder.POIS_NAME)

    def _mission_ends(self, views: list[PlannerView]) -> bool:
        was_finished = self.finished
        if views:
            self.finished = views[-1].finished
        if self.finished and not was_finished:
            _log.info("mission finished poses_until_s=%.1f map_points=%d", self._newest_pose_s, len(self._map))
        return self.finished and not was_finished

    def _append_poses(self) -> None:
        if self._lines is None:
            self.run_dir.mkdir(parents=True, exist_ok=True)
            self._lines = run_folder.LineFile(self.run_dir / run_folder.TRAJECTORY_NAME)
        if self._pending:
            self._lines.append(self._pending)
            self._pending.clear()

    def _write(self, *, with_pictures: bool) -> None:
        works = self._on_disk(self._append_poses) and self._on_disk(self._write_files)
        if works and not self._disk_works:
            _log.info("the disk takes the run again run_dir=%s", self.run_dir)
        self._disk_works = works
        if works and with_pictures:
            self._on_disk(lambda: export_run(self.run_dir, EXPORT_FORMATS))

    def _write_files(self) -> None:
        for name in list(self._photos):
            path = self.run_dir / name
            path.parent.mkdir(exist_ok=True)
            run_folder.write_atomically(path, self._photos[name])
            del self._photos[name]
        writers: dict[str, Callable[[Path], None]] = {
            run_folder.MAP_POINTS_NAME: lambda path: run_folder.write_map_points(path, *self._map.known()),
            run_folder.POIS_NAME: lambda path: run_folder.write_json(path, list(self._pois.values())),
            run_folder.SMOOTHED_NAME: self._write_smoothed,
        }
        for name, write in writers.items():
            path = self.run_dir / name
            if name in self._changed or (name != run_folder.SMOOTHED_NAME and not path.exists()):
                write(path)
                self._changed.discard(name)

    def _write_smoothed(self, path: Path) -> None:
        if self._trajectory is not None:
            times_s, poses = self._trajectory.times_s, self._trajectory.poses
            run_folder.write_tum(path, np.asarray(times_s), np.asarray(poses).reshape(-1, 3))

    def _on_disk(self, action: Callable[[], object]) -> bool:
        """Do it, or say once why the disk refused."""
        try:
            action()
        except OSError as error:
            if self._disk_works:
                _log.error("cannot write the run (%s): free space on the disk of %s", error.strerror, self.run_dir)
            self._disk_works = False
            return False
        return True

    def _report(self, bus: Bus, now_s: float) -> None:
        missing = self._map.missing
        self._status.report(
            bus,
            now_s,
            state="finished" if self.finished else "recording",
            error=ErrorCode.OK if self._disk_works else ErrorCode.DISK_FULL,
            ready=True,
            detail=f"{missing} map points were lost on the way" if missing else "",
        )
