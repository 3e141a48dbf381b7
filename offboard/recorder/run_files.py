"""The files of the run folder, made from what the run database holds: poses, map, points of interest.

`trajectory.tum` grows with every pose; the rest is written when the recorder requests it. What the disk refuses is kept
here and tried again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from common.door_names import DoorNote, added, note_by, note_for, shown
from common.messages.mapping import MapUpdate, PoseEstimate
from common.messages.mapping import Trajectory as SmoothedTrajectory
from common.messages.mission import PlannerView, Zones
from common.messages.points_of_interest import DoorStatement, PointOfInterest
from common.messages.topics import DOOR, MAP, PLAN, POI, POSE, TRAJECTORY, ZONES, Topic
from common.room_number import key_of
from common.zones import as_json, zones_of
from offboard.runs import run_folder
from offboard.runs.map_assembly import MapAssembly

TOPICS_OF_FILES: tuple[Topic[Any], ...] = (POSE, MAP, TRAJECTORY, POI, PLAN, ZONES, DOOR)

_log = logging.getLogger("recorder")


def poi_record(poi: PointOfInterest, photo: str) -> dict[str, Any]:
    """One entry of pois.json; `photo` is the picture's path inside the run folder, empty where there is none."""
    kept = ("poi_id", "name", "description", "x_m", "y_m", "number", "room_type", "confidence", "state", "t_s")
    return {name: getattr(poi, name) for name in kept} | {"key": key_of(poi.number), "photo": photo}


class RunFiles:
    """What the files shall hold. `take` payloads in the order of the database; the writers raise OSError."""

    def __init__(self, run_dir: Path) -> None:
        self.run_dir = run_dir
        self.finished = False
        self.map = MapAssembly()
        self._lines: run_folder.LineFile | None = None
        self._pending: list[str] = []  # poses that are not in the file yet
        self._newest_pose_s = float("-inf")
        self._trajectory: SmoothedTrajectory | None = None
        self._pois: dict[int, dict[str, Any]] = {}
        self._zones: Zones | None = None
        self.notes: tuple[DoorNote, ...] = ()  # by a person, about doors
        self.statement_id = 0  # of the newest of them
        self._photos: dict[str, bytes] = {}  # by name, until they are on the disk
        self._changed: set[str] = set()  # files that differ from what is here
        self._made: set[str] = set()  # those that were written, and cannot all be made from what is here

    def restore(self, summary: bytes) -> bool:
        """Goes on from a `summary`; False, and nothing is changed, where the folder does not hold what it refers to."""
        if not summary:
            return False
        packed_map, pois, newest_pose_s, finished, trajectory_bytes, made, *notes = msgpack.unpackb(summary)
        trajectory = self.run_dir / run_folder.TRAJECTORY_NAME
        there = trajectory.exists() and trajectory.stat().st_size >= trajectory_bytes
        if not there or not all((self.run_dir / name).exists() for name in made):
            return False
        self.map = MapAssembly.unpack(packed_map)
        self._pois = {poi["poi_id"]: poi for poi in pois}
        self._newest_pose_s, self.finished, self._made = newest_pose_s, finished, set(made)
        self.notes = tuple(DoorNote(*row) for rows in notes for row in rows)
        self._lines = run_folder.LineFile(trajectory, trajectory_bytes)
        return True

    def begin(self, payloads: Iterable[object]) -> None:
        """What the database holds beyond what was restored; without that the file of poses is made anew."""
        for payload in payloads:
            self.take(payload)
        if self._lines is None:
            keep_bytes = 0 if self._pending else None
            self._lines = run_folder.LineFile(self.run_dir / run_folder.TRAJECTORY_NAME, keep_bytes)

    def begin_again(self) -> None:
        """In a folder that was taken away: what is known here is written once more."""
        self.close()
        self._lines = run_folder.LineFile(self.run_dir / run_folder.TRAJECTORY_NAME)
        self._made.clear()
        self._changed |= {run_folder.MAP_POINTS_NAME, run_folder.POIS_NAME}
        if self._trajectory is not None:
            self._changed.add(run_folder.SMOOTHED_NAME)
        if self._zones is not None:
            self._changed.add(run_folder.ZONES_NAME)

    def summary(self) -> bytes | None:
        """What it takes to go on with the files without the messages; None while they are behind. Raises OSError."""
        if self._lines is None or self._pending or self._photos or self._changed:
            return None
        self._lines.sync()
        for folder in {(self.run_dir / name).parent for name in (run_folder.POIS_NAME, *self._made)}:
            run_folder.sync_folder(folder)
        notes = [[note.poi_id, note.x_m, note.y_m, note.number, note.room_name] for note in self.notes]
        last = (self._newest_pose_s, self.finished, self._lines.size, sorted(self._made), notes)
        packed: bytes = msgpack.packb([self.map.pack(), list(self._pois.values()), *last])
        return packed

    def take(self, payload: object) -> None:
        """A payload of TOPICS_OF_FILES; others are no matter of the files."""
        if isinstance(payload, PoseEstimate):
            self._take_pose(payload)
        elif isinstance(payload, MapUpdate):
            self._take_map(payload)
        elif isinstance(payload, SmoothedTrajectory):
            self._trajectory = payload
            self._changed.add(run_folder.SMOOTHED_NAME)
        elif isinstance(payload, PointOfInterest):
            self._take_poi(payload)
        elif isinstance(payload, DoorStatement):
            self._take_statement(payload)
        elif isinstance(payload, Zones):
            self._zones = payload
            self._changed.add(run_folder.ZONES_NAME)
        elif isinstance(payload, PlannerView):
            self._take_view(payload)

    def append_poses(self) -> None:
        """The poses that are not in the file yet."""
        if self._lines is not None and self._pending:
            self._lines.append(self._pending)
            self._pending.clear()

    def write(self) -> None:
        """Every file that is not as it should be."""
        for name in list(self._photos):
            path = self.run_dir / name
            path.parent.mkdir(exist_ok=True)
            run_folder.write_atomically(path, self._photos[name])
            self._made.add(name)
            del self._photos[name]
        writers: dict[str, Callable[[Path], None]] = {
            run_folder.MAP_POINTS_NAME: lambda path: run_folder.write_map_points(path, *self.map.known()),
            run_folder.POIS_NAME: lambda path: run_folder.write_json(path, list(map(self._shown, self._pois.values()))),
            run_folder.SMOOTHED_NAME: self._write_smoothed,
            run_folder.ZONES_NAME: self._write_zones,
        }
        always = (run_folder.MAP_POINTS_NAME, run_folder.POIS_NAME)
        for name, write in writers.items():
            path = self.run_dir / name
            if name in self._changed or (name in always and not path.exists()):
                write(path)
                self._made.add(name)
                self._changed.discard(name)

    def close(self) -> None:
        if self._lines is not None:
            self._lines.close()
            self._lines = None

    def _take_pose(self, pose: PoseEstimate) -> None:
        if pose.t_s > self._newest_pose_s:
            self._newest_pose_s = pose.t_s
            self._pending.append(run_folder.tum_line(pose.t_s, pose.x_m, pose.y_m, pose.heading_rad))

    def _take_map(self, update: MapUpdate) -> None:
        lost = self.map.add(update)
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

    def _take_statement(self, statement: DoorStatement) -> None:
        self.notes = added(self.notes, note_by(statement))
        self.statement_id = statement.command_id
        self._changed.add(run_folder.POIS_NAME)

    def _shown(self, record: dict[str, Any]) -> dict[str, Any]:
        """With what counts in place of what was read, where a person has said something."""
        note = note_for(self.notes, record["poi_id"], record["x_m"], record["y_m"])
        if note is None:
            return record
        counts = shown(record["number"], record["state"], note)
        read = {"number_read": record["number"], "state_read": record["state"]}
        return record | read | asdict(counts) | {"key": key_of(counts.number)}

    def _take_view(self, view: PlannerView) -> None:
        if view.outcome.ends_mission and not self.finished:
            _log.info(
                "mission outcome=%s poses_until_s=%.1f map_points=%d",
                view.outcome.value,
                self._newest_pose_s,
                len(self.map),
            )
        self.finished = view.outcome.ends_mission

    def _write_zones(self, path: Path) -> None:
        if self._zones is not None:
            run_folder.write_json(path, as_json(zones_of(self._zones)))

    def _write_smoothed(self, path: Path) -> None:
        if self._trajectory is not None:
            times_s, poses = self._trajectory.times_s, self._trajectory.poses
            run_folder.write_tum(path, np.asarray(times_s), np.asarray(poses).reshape(-1, 3))
