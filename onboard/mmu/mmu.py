"""The mapping unit as a node: odometry and ranges in; pose, wall points, occupancy grid and trajectory out."""

from __future__ import annotations

import argparse
import logging
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any

from common.bus import Bus, alive, expires_s
from common.config import Config
from common.constants import MAP_TOLERANCE_M
from common.errors import ErrorCode
from common.geometry import Pose2, wrap_angle
from common.messages.mapping import PoseEstimate, Trajectory
from common.messages.mission import Operation, OperatorCommand, PoseAnswer
from common.messages.motion import Odometry
from common.messages.topics import (
    GRID,
    MAP,
    ODOMETRY,
    OPERATION,
    POSE,
    POSE_ANSWER,
    RANGES,
    TRAJECTORY,
    Topic,
)
from common.pace import Pace
from common.side_process import ProcessWorker
from common.status import StatusReporter
from onboard.mmu.back_end.back_end_link import BackEndWorker
from onboard.mmu.back_end.exchange import Correction, Increment
from onboard.mmu.front_end.stated_pose import Verdict
from onboard.mmu.map.grid_encoder import GridEncoder
from onboard.mmu.map.map_file import MAP_NAME, SavedMap, load_map
from onboard.mmu.map.map_increments import MapIncrements
from onboard.mmu.slam import ROBOT, Carrier, Slam

BACK_END = "onboard.mmu.back_end.back_end_process:load"
# How often each is published at most
GRID_PERIOD_S = 1.0
TRAJECTORY_PERIOD_S = 10.0
MAX_SD_M = MAP_TOLERANCE_M  # a pose less certain than this is not valid

_log = logging.getLogger("mmu")


class MappingUnit:
    """Node "mmu". One map per run: its frame is the pose at the first report."""

    name = "mmu"
    period_s = 0.15  # longer than that of odometry, which makes nearly every step due
    wakes_on: tuple[Topic[Any], ...] = (ODOMETRY, RANGES)

    def __init__(
        self,
        worker: BackEndWorker,
        carrier: Carrier = ROBOT,
        saved: SavedMap | None = None,
    ) -> None:
        """`worker`: where the back end runs; `saved`: a prior map, to continue in."""
        self._slam = Slam(worker, carrier, saved)
        self._status = StatusReporter(self.name)
        self._increments = MapIncrements()
        self._grid_pace, self._trajectory_pace = Pace(GRID_PERIOD_S), Pace(TRAJECTORY_PERIOD_S)
        self._grid_encoder = GridEncoder()
        self._pose: PoseEstimate | None = None
        self._answer: PoseAnswer | None = None

    def step(self, bus: Bus, now_s: float) -> float:
        for odometry in bus.take(ODOMETRY):
            self._update_pose(bus, odometry)
        for command in bus.take(OPERATION):
            if command.operation is Operation.POSE and command.valid:
                self._take_stated(bus, command, now_s)
        for ranges in bus.take(RANGES):
            if ranges.valid:
                self._slam.add_ranges(ranges)
        fresh = alive(bus, ODOMETRY)
        if self._pose is not None and not fresh and self._pose.valid:
            self._pose = replace(self._pose, valid=False)
            bus.publish(POSE, self._pose)
        if self._slam.travel_m or self._pose is not None:
            self._publish_map(bus, now_s)
        ready = fresh and self._pose is not None and self._pose.valid
        error = ErrorCode.OK if ready else ErrorCode.POSE_UNCERTAIN if fresh else ErrorCode.NO_ODOMETRY
        self._status.report(bus, now_s, state="MAPPING" if ready else "WAITING", error=error, ready=ready)
        # What else is due waits for the next odometry; where none comes, only the status is left to be published
        return min(expires_s(bus, ODOMETRY, now_s), self._status.latest_s) if fresh else self._status.due_s

    def close(self) -> None:
        self._slam.close()

    def _update_pose(self, bus: Bus, odometry: Odometry) -> None:
        if not odometry.valid:
            return
        if not self._slam.add_odometry(odometry):
            return  # broken, or the first of a board that restarted: the next one shows which
        self._publish_pose(bus, odometry)

    def _publish_pose(self, bus: Bus, odometry: Odometry) -> None:
        pose = self._slam.pose
        uncertainty = self._slam.uncertainty
        self._pose = PoseEstimate(
            t_s=odometry.t_s,
            x_m=pose.x_m,
            y_m=pose.y_m,
            heading_rad=pose.heading_rad,
            yaw_rad=odometry.yaw_rad,
            sd_xy_m=uncertainty.sd_m,
            sd_heading_rad=uncertainty.sd_heading_rad,
            map_revision=self._slam.map.revision,
            valid=uncertainty.sd_m < MAX_SD_M,
            sd_least_m=uncertainty.sd_least_m,
            worst_rad=uncertainty.worst_rad,
        )
        bus.publish(POSE, self._pose)

    def _take_stated(self, bus: Bus, command: OperatorCommand, now_s: float) -> None:
        """A person says where the robot stands; answered once, and the answer again where the command comes again."""
        if self._answer is None or self._answer.command_id != command.command_id:
            verdict = self._judge_stated(bus, command)
            _log.info("stated pose %s refused=%s %s", _place_text(command), verdict.refused, verdict.note)
            self._answer = PoseAnswer(now_s, command.command_id, verdict.refused, verdict.note)
        bus.publish(POSE_ANSWER, self._answer)

    def _judge_stated(self, bus: Bus, command: OperatorCommand) -> Verdict:
        odometry, ranges = bus.latest(ODOMETRY), bus.latest(RANGES)
        if odometry is None or ranges is None or not alive(bus, ODOMETRY) or not alive(bus, RANGES):
            return Verdict(True, "Nothing is received from the wheels or the sonars.")
        if not odometry.standing:
            return Verdict(True, "The robot moves: pause it first.")
        pose = Pose2(command.x_m, command.y_m, wrap_angle(command.heading_rad))
        verdict = self._slam.place(odometry.t_s, pose, command.sd_m, command.sd_heading_rad, ranges.range_m)
        if not verdict.refused:
            self._publish_pose(bus, odometry)
        return verdict

    def _publish_map(self, bus: Bus, now_s: float) -> None:
        drawn = self._slam.map
        update = self._increments.next(drawn, now_s)
        if update is not None:
            bus.publish(MAP, update)
        grid = self._grid_encoder.advance(now_s)
        if grid is not None:
            bus.publish(GRID, grid)
        elif not self._grid_encoder.busy and self._grid_pace.due(now_s):
            drawn.draw_newest()
            self._grid_encoder.begin(drawn.grid)
        if self._trajectory_pace.due(now_s, urgent=update is not None and update.start == 0):
            bus.publish(TRAJECTORY, Trajectory(now_s, *self._slam.trajectory()))


def _place_text(command: OperatorCommand) -> str:
    heading_deg, sd_deg = degrees(command.heading_rad), degrees(command.sd_heading_rad)
    place = f"place={command.x_m:.2f},{command.y_m:.2f} heading_deg={heading_deg:.0f}"
    return f"{place} sd_m={command.sd_m:.2f} sd_deg={sd_deg:.0f}"


def carrier_of(config: Config) -> Carrier:
    """This very robot, as it was calibrated."""
    return Carrier(config.sonars.bearings_rad, tick_m=config.wheels.tick_m, track_m=config.wheels.track_m)


def make_mapping_unit(config: Config, arguments: argparse.Namespace) -> MappingUnit:
    """The node of the process; the map stands in the log folder, and a process that restarts continues in it."""
    folder: Path | None = arguments.log_dir
    file = folder / MAP_NAME if folder else None
    back_end = ProcessWorker[Increment, Correction]("back end", BACK_END, *([str(file)] if file else []))
    return MappingUnit(back_end, carrier_of(config), load_map(file) if file else None)
