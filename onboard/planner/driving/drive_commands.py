"""What is wanted -> `DRIVE`: numbered commands to the Carrier, a new one only where something has changed."""

from __future__ import annotations

import math
from dataclasses import replace

from common.bus import Bus
from common.constants import ANGLE_ERROR_RAD, POSE_RATE_HZ
from common.geometry import wrap_angle
from common.messages.mapping import PoseEstimate
from common.messages.motion import DriveCommand, Speed
from common.messages.topics import DRIVE
from common.pace import Pace
from onboard.planner.driving.net_rotation_balancing import NetRotationBalancing
from onboard.planner.grid.view import Motion

PERIOD_S = 1.0 / POSE_RATE_HZ
COMMAND_MAX_S = 1.0  # a command in motion is not repeated for longer than this; then comes a new one
# A heading that has changed by less is no new command. Driven: half of what the Carrier holds it to
STANDING_HEADING_RAD, DRIVEN_HEADING_RAD = 0.03, ANGLE_ERROR_RAD / 2
BOOT_BITS = 16


class DriveCommands:
    """Publishes at the topic's rate, and at once when the speed changes."""

    def __init__(self, boot: int) -> None:
        """`boot`, of BOOT_BITS: another number after each restart, which distinguishes the commands from the earlier
        ones."""
        self._boot = boot
        self._net_rotation = NetRotationBalancing()
        self._pace = Pace(PERIOD_S)
        self._newest: DriveCommand | None = None
        self._id, self._began_s = 0, -math.inf  # of the newest

    @property
    def latest_s(self) -> float:
        """When the next one must be published (s)."""
        return self._pace.latest_s if self._newest is not None else math.inf

    def publish(self, bus: Bus, now_s: float, motion: Motion, pose: PoseEstimate) -> None:
        """To be called in every step."""
        turn_rad = self._net_rotation.turn_rad(pose.yaw_rad, wrap_angle(motion.heading_rad - pose.heading_rad))
        yaw_rad = wrap_angle(pose.yaw_rad + turn_rad)
        newest = self._newest
        if not self._pace.due(now_s, urgent=newest is None or motion.speed is not newest.speed):
            return
        if newest is not None and self._holds(newest, motion.speed, yaw_rad, now_s):
            command, news = replace(newest, t_s=now_s), False
        else:
            self._id, self._began_s = self._id + 1, now_s
            command, news = DriveCommand(now_s, self._id, motion.speed, yaw_rad, boot=self._boot), True
        self._newest = command
        bus.publish(DRIVE, command, news=news)

    def _holds(self, newest: DriveCommand, requested: Speed, yaw_rad: float, now_s: float) -> bool:
        """It is still what is wanted. In motion for COMMAND_MAX_S at most: bridge and board begin no command again
        that they have dropped."""
        turned_rad = abs(wrap_angle(yaw_rad - newest.yaw_rad))
        if requested is not newest.speed:
            return False
        if requested is Speed.STOP:
            return turned_rad < STANDING_HEADING_RAD
        return turned_rad < DRIVEN_HEADING_RAD and now_s - self._began_s < COMMAND_MAX_S
