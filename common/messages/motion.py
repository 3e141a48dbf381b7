"""What the robot does and senses: drive commands, odometry, ranges, the Carrier's report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from common.fields import (
    Boot,
    CommandId,
    Epoch,
    Identity,
    Metres,
    MetresPerSecond,
    Pwm,
    Radians,
    RadiansPerSecond,
    Range,
    Seconds,
    SonarAges,
    SonarRanges,
    StopIds,
    StopNames,
    Ticks,
    Volts,
)


class Speed(IntEnum):
    """Desired_Speed: the signed enum of decisions 1 and 14."""

    REVERSE = -1
    STOP = 0
    MEDIUM = 1
    HIGH = 2


class CarrierState(Enum):
    """The firmware's safety state."""

    BOOT = "BOOT"
    DISARMED = "DISARMED"
    READY = "READY"
    MOVING = "MOVING"
    BACKING_OFF = "BACKING"
    STOPPED = "STOPPED"
    FAULT = "FAULT"


@dataclass(frozen=True, slots=True)
class Odometry:
    """What SIM knows of its own motion (SIM_MR_02..04): cumulative ticks, yaw and dead reckoning since power-on."""

    t_s: Seconds
    ticks_left: Ticks
    ticks_right: Ticks
    yaw_rad: Radians
    yaw_rate_rad_s: RadiansPerSecond
    x_m: Metres
    y_m: Metres
    speed_m_s: MetresPerSecond
    standing: bool  # wheels still, gyro bias being tracked
    bumper: bool
    cliff: bool
    session: Identity  # changes when the board restarts: ticks and yaw begin anew
    valid: bool = True
    yaw_by_walls_rad: Radians = 0.0  # that much of `yaw_rad` comes from walls, the rest from the gyro


@dataclass(frozen=True, slots=True)
class Ranges:
    """dist_Sensors_Array: five ranges from the ring's centre, NaN where nothing answered (no information)."""

    t_s: Seconds
    range_m: SonarRanges  # in the order of constants.SONAR_NAMES
    age_s: SonarAges  # how long before t_s each was measured
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Distances:
    """dist_left, dist_right, dist_front: aggregated distances from the ring's centre to the walls, NaN where none."""

    t_s: Seconds
    left_m: Range
    right_m: Range
    front_m: Range
    valid: bool = True


@dataclass(frozen=True, slots=True)
class CarrierReport:
    """Completed and the state of the Carrier, ten times a second and at once on change."""

    t_s: Seconds
    state: CarrierState
    command_id: CommandId  # the drive command in force, 0 = none
    completed_id: CommandId  # the newest one completed
    aborted_id: CommandId  # the newest one given up
    speed_m_s: MetresPerSecond
    pwm_left: Pwm
    pwm_right: Pwm
    enabled: bool  # motor driver
    stop_latched: bool
    battery_v: Volts
    valid: bool = True
    boot: Boot = 0  # of the drive commands whose ids stand above
    board_epoch: Epoch = 0  # the newest stop epoch that the firmware knows
    bridge_epoch: Epoch = 0  # the newest that the bridge received in a permit, 0 = none since its start
    comm_life: Identity = 0  # of the newest permit that the bridge received
    stop_ids: StopIds = ()  # stops that the bridge holds and no permit has quoted yet
    stop_names: StopNames = ()  # their sources, in the same order
    button_pressed: bool = False  # the robot's own stop button, right now


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """Desired_Speed and Desired_Angle: drive at `speed` along `yaw_rad` of SIM's own yaw. Newer replaces older."""

    t_s: Seconds
    command_id: CommandId
    speed: Speed
    yaw_rad: Radians
    valid: bool = True
    boot: Boot = 0  # of the planner: a restarted one counts its commands anew; 16 bits
