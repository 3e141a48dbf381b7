"""The Planner as a node: pose, grid, wall points and distances in; drive commands and a view for people out."""

from __future__ import annotations

import argparse
import logging
import math
import secrets
from pathlib import Path
from typing import Any

import numpy as np

from common.bus import Bus, alive, alive_and_valid, expires_s
from common.config import Config
from common.constants import PLANNER_CLEARANCE_M, SPEED_MEDIUM_M_S, TURN_ON_SPOT_RAD
from common.errors import ErrorCode
from common.geometry import Pose2, wrap_angle
from common.messages.mapping import PoseEstimate
from common.messages.mission import Operation, OperatorCommand, Outcome, PlannerView
from common.messages.motion import CarrierState, Speed
from common.messages.points_of_interest import PoiCommand, PoiRequest
from common.messages.stop import Permit
from common.messages.topics import (
    CARRIER,
    DISTANCES,
    ODOMETRY,
    OPERATION,
    PERMIT,
    PLAN,
    POSE,
    RANGES,
    RETAKE,
    ZONES,
    Topic,
)
from common.mission_state import is_stopped
from common.side_process import ProcessWorker
from common.status import StatusReporter
from common.zones import ZONE_OPERATIONS, message_of
from onboard.planner.driving import collision_monitor
from onboard.planner.driving.collision_monitor import CollisionMonitor, Phase, stopping_m, watch
from onboard.planner.driving.drive_commands import BOOT_BITS, DriveCommands
from onboard.planner.driving.poi_override import Override, after, speed
from onboard.planner.driving.zero_velocity_update import ZeroVelocityUpdate
from onboard.planner.grid.deliberation import BESIDE, Deliberator, Query
from onboard.planner.grid.view import Motion
from onboard.planner.known_floor import KnownFloor
from onboard.planner.mission.battery_watch import BatteryWatch
from onboard.planner.mission.mission import Mission
from onboard.planner.mission.orders import Orders
from onboard.planner.mission.table import AT_REST, BLOCKED, GOING_HOME, Event, Step
from onboard.planner.routing.destination import has_floor
from onboard.planner.zones.zone_file import ZONES_NAME
from onboard.planner.zones.zone_guard import with_border
from onboard.planner.zones.zone_keeper import ZoneKeeper

VIEW_PERIOD_S = 0.5
PATH_SHOWN_MAX = 2_000  # waypoints
BATTERY_PERIOD_S = 1.0
BATTERY_MATTERS_S = 1800.0  # left: a way home takes less
NOT_CALLED_HOME = (*AT_REST, *GOING_HOME)
BACK_ROOM_M = PLANNER_CLEARANCE_M + stopping_m(SPEED_MEDIUM_M_S)  # behind it, to a border that no sonar hears

_log = logging.getLogger(__name__)


class Planner:
    """Node "planner". Drives only after a start, with a permit and a valid pose."""

    name = "planner"
    period_s = 0.1
    # Distances and carrier come in one bundle with the ranges, or wait for the next step
    wakes_on: tuple[Topic[Any], ...] = (POSE, RANGES, PERMIT, OPERATION, RETAKE)

    def __init__(
        self, deliberator: Deliberator, images_walls: bool = False, boot: int = 0, zones: ZoneKeeper | None = None
    ) -> None:
        """`deliberator` answers queries. `images_walls`: there is a camera, and every wall shall have been on its
        right. `boot`: of its drive commands. `zones`: without, they are forgotten in the end."""
        self._mission = Mission(images_walls=images_walls)
        self._zones = zones or ZoneKeeper()
        self._floor = KnownFloor(deliberator, self._mission, self._zones)
        self._status = StatusReporter(self.name)
        self._collision = CollisionMonitor()
        self._zero_velocity = ZeroVelocityUpdate()
        self._battery, self._battery_s = BatteryWatch(), -math.inf
        self._zones_sent = -1  # their revision, as published
        self._wanted = Motion(Speed.STOP, 0.0)
        self._pose_seen: PoseEstimate | None = None
        self._commands = DriveCommands(boot)
        self._view_sent_s = -math.inf
        self._orders = Orders()
        self._override = Override()

    def step(self, bus: Bus, now_s: float) -> float:
        if self._floor.receive(bus, now_s):
            self._pose_seen = None  # the mission goes on at once
        pose = bus.latest(POSE)
        for command in bus.take(OPERATION):
            if command.operation is not Operation.POSE:
                self._operate(command, pose, bus.latest(PERMIT), now_s)
        for request in bus.take(RETAKE):
            self._take_poi_request(request, pose, now_s)
        permit = bus.latest(PERMIT)
        if permit is not None and is_stopped(permit) is not (self._mission.state.outcome is Outcome.STOPPED):
            self._mission.order(Event.STOPPED if is_stopped(permit) else Event.STOP_OVER)
        error = self._trouble(bus)
        if pose is None or error is not ErrorCode.OK:
            self._collision = CollisionMonitor()
            if pose is not None:
                self._commands.publish(bus, now_s, Motion(Speed.STOP, pose.heading_rad), pose)
        else:
            self._drive(bus, now_s, pose)
            if self._collision.phase is not Phase.CLEAR:
                error = ErrorCode.EMERGENCY_ROUTINE
            elif self._mission.mode in BLOCKED:
                error = ErrorCode.BLOCKED
        self._keep_zones(bus, now_s)
        self._watch_battery(bus, now_s, pose)
        for note in self._mission.log.take():
            _log.info("%s", note)
        self._floor.query(self._mission.pending.take(), now_s)
        self._report(bus, now_s, error)
        return self._due_s(bus, now_s)

    def close(self) -> None:
        self._floor.close()
        self._zones.close()

    def _operate(
        self, command: OperatorCommand, pose: PoseEstimate | None, permit: Permit | None, now_s: float
    ) -> None:
        if self._orders.is_repeat(command):
            self._view_sent_s = -math.inf  # the answer was lost
            return
        if command.operation in ZONE_OPERATIONS:
            if pose is not None:
                self._orders.answered(command, permit, self._order_zone(command, pose))
                self._view_sent_s = -math.inf
            return
        event = self._orders.event_of(command, permit)
        if event is None or (event is Event.START and pose is None):
            return  # no answer yet: it comes again
        place_m = (command.x_m, command.y_m)
        if event is Event.GO_TO and self._zones.forbids(place_m):
            event = Event.GO_FORBIDDEN
        elif event is Event.GO_TO and self._floor.grid is not None and not has_floor(self._floor.grid, place_m):
            event = Event.GO_NOWHERE
        if event is Event.START:
            assert pose is not None
            step = self._mission.start(pose.pose, now_s)
        else:
            step = self._mission.order(event, place_m)
        _log.info("operation=%s refused=%s %s", event.name, step.refused, step.note)
        self._orders.answered(command, permit, step)
        if command.command_id:
            self._view_sent_s = -math.inf

    def _order_zone(self, command: OperatorCommand, pose: PoseEstimate) -> Step:
        answer = self._zones.order(command, pose.pose)
        _log.info("operation=%s refused=%s %s", command.operation.value, answer.refused, answer.note)
        if not answer.refused:
            self._mission.replan()
        return Step(self._mission.state, refused=answer.refused, note=answer.note)

    def _watch_battery(self, bus: Bus, now_s: float, pose: PoseEstimate | None) -> None:
        """Sends it home in time; how far that is, is asked while it may matter before long."""
        carrier = bus.latest(CARRIER)
        if now_s < self._battery_s or carrier is None or pose is None or self._mission.mode in NOT_CALLED_HOME:
            return
        self._battery_s = now_s + BATTERY_PERIOD_S
        self._battery.see(now_s, carrier.battery_v)
        left_s = self._battery.left_s
        if left_s < BATTERY_MATTERS_S:
            self._floor.query_home_distance(now_s, pose)
        home_m = self._floor.home_m
        if self._battery.calls_home(home_m):
            _log.info("battery_v=%.2f left_s=%.0f home_m=%.1f", carrier.battery_v, left_s, home_m)
            self._mission.order(Event.BATTERY_LOW)

    def _keep_zones(self, bus: Bus, now_s: float) -> None:
        self._zones.step(now_s)
        if self._zones_sent != self._zones.revision:
            self._zones_sent = self._zones.revision
            bus.publish(ZONES, message_of(now_s, self._zones.zones))

    def _take_poi_request(self, request: PoiRequest, pose: PoseEstimate | None, now_s: float) -> None:
        turning = pose is not None and _turns_on_the_spot(self._wanted, pose)
        self._override = after(self._override, request.command, now_s, turning)
        if request.command is PoiCommand.GOTO and not turning:
            self._mission.detour(Pose2(request.x_m, request.y_m, request.heading_rad))
        if request.command is PoiCommand.CONTINUE and pose is not None:
            self._mission.end_detour(pose.heading_rad, now_s)

    def _trouble(self, bus: Bus) -> ErrorCode:
        """Why the robot must stand; OK where it need not."""
        permit = bus.latest(PERMIT)
        if not alive_and_valid(bus, POSE):
            return ErrorCode.NO_POSE
        if not alive(bus, RANGES) or not alive(bus, DISTANCES):
            return ErrorCode.NO_RANGES
        if self._zones.damaged:
            return ErrorCode.ZONES_LOST
        return ErrorCode.OK if permit is not None and permit.granted else ErrorCode.NO_PERMIT

    def _drive(self, bus: Bus, now_s: float, pose: PoseEstimate) -> None:
        ranges, carrier, odometry = bus.latest(RANGES), bus.latest(CARRIER), bus.latest(ODOMETRY)
        assert ranges is not None
        rests = self._zero_velocity.due(now_s, odometry is not None and odometry.standing)
        backing = carrier is not None and carrier.state is CarrierState.BACKING_OFF
        if self._floor.grid is None or self._mission.state.paused or backing:
            self._collision = CollisionMonitor()
            self._commands.publish(bus, now_s, Motion(Speed.STOP, pose.heading_rad), pose)
            return
        if pose is not self._pose_seen:
            self._pose_seen = pose
            requested = speed(self._override, now_s)
            if requested is None:
                self._wanted = self._mission.step(self._floor.view(now_s, pose))
            else:
                self._wanted = Motion(requested, pose.heading_rad)
        speed_m_s = carrier.speed_m_s if carrier is not None else SPEED_MEDIUM_M_S
        # On the spot it may turn away from anything
        ahead = Speed.STOP if _turns_on_the_spot(self._wanted, pose) else self._wanted.speed
        here = pose.pose
        ranges_m = with_border(ranges.range_m, self._zones.guard.room_m(here, pose.heading_rad))
        self._collision, blocked = watch(self._collision, now_s, ahead, ranges_m, speed_m_s)
        if blocked:
            self._mission.blocked(self._floor.view(now_s, pose), self._collision.bearing_rad)
        motion = self._wanted
        if self._collision.phase is Phase.STOPPED:
            motion = Motion(Speed.STOP, pose.heading_rad)
        elif self._collision.phase is Phase.BACKING:
            motion = Motion(Speed.REVERSE, pose.heading_rad)
        elif rests and not _turns_on_the_spot(motion, pose):
            motion = Motion(Speed.STOP, pose.heading_rad)
        if motion.speed is Speed.REVERSE and self._zones.guard.room_m(here, here.heading_rad + math.pi) < BACK_ROOM_M:
            motion = Motion(Speed.STOP, pose.heading_rad)
        self._commands.publish(bus, now_s, motion, pose)

    def _due_s(self, bus: Bus, now_s: float) -> float:
        """When there is something to do though nothing arrives."""
        return min(
            self._status.latest_s,
            self._commands.latest_s,
            self._floor.due_s(now_s),
            self._zones.due_s(now_s),
            collision_monitor.due_s(self._collision),
            *(expires_s(bus, topic, now_s) for topic in (POSE, RANGES, DISTANCES)),
        )

    def _report(self, bus: Bus, now_s: float, error: ErrorCode) -> None:
        mission = self._mission.state
        state = "PAUSED" if mission.paused else mission.mode.name
        self._status.report(
            bus, now_s, state=state, error=error, ready=error not in (ErrorCode.NO_POSE, ErrorCode.NO_RANGES)
        )
        if now_s - self._view_sent_s < VIEW_PERIOD_S:
            return
        self._view_sent_s = now_s
        path = np.array(self._mission.path[:PATH_SHOWN_MAX], dtype=np.float32).reshape(-1, 2)
        grid = self._floor.grid
        area_m2 = grid.area_m2 if grid is not None else 0.0
        answer = self._orders.answer
        bus.publish(
            PLAN,
            PlannerView(
                now_s,
                mission.mode.name,
                self._mission.log.text,
                path,
                len(self._mission.frontiers.groups),
                area_m2,
                mission.outcome,
                command_id=answer.command_id,
                refused=answer.refused,
                note=answer.note,
                paused=mission.paused,
                blacklisted=self._mission.log.blacklisted,
            ),
        )


def _turns_on_the_spot(motion: Motion, pose: PoseEstimate) -> bool:
    """The Carrier stops and turns before it drives on."""
    return abs(wrap_angle(motion.heading_rad - pose.heading_rad)) > TURN_ON_SPOT_RAD


def make_planner(config: Config, arguments: argparse.Namespace) -> Planner:
    """The node of the process; the zones stand in the log folder, beside the map."""
    folder: Path | None = arguments.log_dir
    deliberator = ProcessWorker[Query, Any]("deliberation", BESIDE)
    zones = ZoneKeeper(folder / ZONES_NAME if folder else None)
    return Planner(deliberator, config.has_camera, secrets.randbits(BOOT_BITS), zones)
