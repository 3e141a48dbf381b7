"""How a map grew while a range log was replayed: the messages of the mapping unit, in a run database that `view` plays.

Times are the log's. Poses, wall points and path are as the mapping unit publishes them, in the frame of the files that
are written beside it.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from common.bus import UNFIT
from common.codec import encode
from common.errors import StartError
from common.field_checks import UnfitValue
from common.messages.mapping import MapUpdate, PoseEstimate, Trajectory
from common.messages.topics import MAP, POSE, TRAJECTORY, Topic
from common.pace import Pace
from common.recording import RecordedMessage
from common.undecodable import Undecodable
from offboard.replay.range_log import RangeLog
from offboard.replay.replay import in_frame_of_log
from offboard.runs.run_folder import DATABASE_NAME
from offboard.runs.run_schema import Delivery, RunDatabase
from onboard.mmu.map.map_increments import MapIncrements
from onboard.mmu.slam import Slam

POSE_PERIOD_S, TRAJECTORY_PERIOD_S = 0.1, 10.0
BOOT_ID = 1


class ReplayRecord:
    """`add` after every scan. Replaces what the folder holds of an earlier one. Raises StartError."""

    def __init__(self, folder: Path, log: RangeLog) -> None:
        self._file, self._log = folder / DATABASE_NAME, log
        self._increments = MapIncrements()
        self._pose_pace, self._trajectory_pace = Pace(POSE_PERIOD_S), Pace(TRAJECTORY_PERIOD_S)
        self._sequences: dict[str, int] = {}
        self._pending: list[RecordedMessage] = []
        self._unfit = Undecodable(UNFIT)
        try:
            for left_over in folder.glob(f"{DATABASE_NAME}*"):
                left_over.unlink()
            # No date: the log's own clock may be any
            self._database = RunDatabase(self._file, None, recorder_id=BOOT_ID)
        except (OSError, sqlite3.Error) as error:
            raise self._refusal(error) from error

    def __enter__(self) -> ReplayRecord:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._database.close()

    def add(self, t_s: float, slam: Slam) -> None:
        """The newest of everything, as often as the mapping unit publishes it."""
        if self._pose_pace.due(t_s):
            x_m, y_m, heading_rad = in_frame_of_log(slam.pose.as_array()[None], self._log)[0].tolist()
            doubt = slam.uncertainty
            pose = PoseEstimate(
                t_s,
                x_m,
                y_m,
                heading_rad,
                0.0,
                doubt.sd_m,
                doubt.sd_heading_rad,
                slam.map.revision,
                sd_least_m=doubt.sd_least_m,
                worst_rad=doubt.worst_rad,
            )
            self._keep(POSE, pose)
        update = self._increments.next(slam.map, t_s)
        if update is not None:
            points_m = (update.points_m + self._log.centre_m).astype(np.float32)
            self._keep(MAP, MapUpdate(t_s, update.revision, update.start, points_m, update.inferred))
        if self._trajectory_pace.due(t_s, urgent=update is not None and update.start == 0):
            times_s, poses = slam.trajectory()
            self._keep(TRAJECTORY, Trajectory(t_s, times_s, in_frame_of_log(poses, self._log)))
        if self._pending:
            self._store(t_s)

    def _keep(self, topic: Topic[Any], payload: Any) -> None:
        sequence = self._sequences.get(topic.key, 0) + 1
        try:
            data = encode(payload, sequence, BOOT_ID)
        except UnfitValue as error:
            self._unfit.count(topic.key, str(error))
            return
        self._sequences[topic.key] = sequence
        self._pending.append(RecordedMessage(topic.key, BOOT_ID, sequence, data))

    def _store(self, arrived_s: float) -> None:
        try:
            self._database.store_data(Delivery(arrived_s, self._pending))
        except (OSError, sqlite3.Error) as error:
            raise self._refusal(error) from error
        self._pending = []

    def _refusal(self, error: Exception) -> StartError:
        return StartError(f"{self._file} cannot be written: {error}.")
