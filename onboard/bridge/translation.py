"""Messages of the serial line (integers in mm, 0.01 deg, ms) <-> messages of the mesh (SI). Pure."""

from __future__ import annotations

from itertools import islice
from math import degrees, nan, radians

from common.constants import SONAR_AGE_MAX_S, SONAR_RING_RADIUS_M
from common.errors import ErrorCode
from common.fields import STOPS_MAX
from common.geometry import wrap_angle
from common.messages.health import Status
from common.messages.motion import CarrierReport, CarrierState, Distances, DriveCommand, Odometry, Ranges
from onboard.bridge.motion_gate import MotionGate
from onboard.bridge.protocol import CarSta, CarState, Drv, Dst, Odo, OdoFlag, Rng, SimSta, SimState, StopSourceFlag, Stp

_STATES = {
    CarState.BOOT: CarrierState.BOOT,
    CarState.DISARMED: CarrierState.DISARMED,
    CarState.READY: CarrierState.READY,
    CarState.MOVING: CarrierState.MOVING,
    CarState.BACKING_OFF: CarrierState.BACKING_OFF,
    CarState.STOPPED: CarrierState.STOPPED,
    CarState.FAULT: CarrierState.FAULT,
}
_CLIFF = OdoFlag.CLIFF_LEFT | OdoFlag.CLIFF_RIGHT


def odometry(odo: Odo, t_s: float, session: int, imu_works: bool) -> Odometry:
    flags = OdoFlag(odo.flags)
    return Odometry(
        t_s=t_s,
        ticks_left=odo.ticks_left,
        ticks_right=odo.ticks_right,
        yaw_rad=wrap_angle(radians(odo.yaw_cdeg / 100.0)),
        yaw_rate_rad_s=radians(odo.rate_cdps / 100.0),
        x_m=odo.x_mm / 1000.0,
        y_m=odo.y_mm / 1000.0,
        speed_m_s=odo.speed_mm_s / 1000.0,
        standing=bool(flags & OdoFlag.STANDING),
        bumper=bool(flags & OdoFlag.BUMPER),
        cliff=bool(flags & _CLIFF),
        session=session,
        valid=imu_works and bool(flags & OdoFlag.CALIBRATED),
        yaw_by_walls_rad=radians(odo.by_walls_cdeg / 100.0),
    )


def ranges(rng: Rng, t_s: float) -> Ranges:
    """From the ring's centre; what is older than SONAR_AGE_MAX_S counts as no echo."""
    ages_s = tuple(age_ms / 1000.0 for age_ms in rng.age_ms)
    ranges_m = tuple(
        mm / 1000.0 + SONAR_RING_RADIUS_M if mm and age_s <= SONAR_AGE_MAX_S else nan
        for mm, age_s in zip(rng.range_mm, ages_s, strict=True)
    )
    return Ranges(t_s, ranges_m, ages_s)


def distances(dst: Dst, t_s: float) -> Distances:
    left_m, right_m, front_m = (mm / 1000.0 if mm else nan for mm in dst)
    return Distances(t_s, left_m, right_m, front_m)


def carrier_report(sta: CarSta, stop: Stp, t_s: float, gate: MotionGate) -> CarrierReport:
    held = dict(islice(gate.held.items(), STOPS_MAX))  # the others come once these are quoted
    return CarrierReport(
        t_s=t_s,
        state=_STATES[CarState(sta.state)],
        command_id=sta.command_id,
        completed_id=sta.completed_id,
        aborted_id=sta.aborted_id,
        speed_m_s=sta.speed_mm_s / 1000.0,
        pwm_left=sta.pwm_left,
        pwm_right=sta.pwm_right,
        enabled=bool(sta.enabled),
        stop_latched=bool(sta.stop_latched),
        battery_v=sta.battery_mv / 1000.0,
        boot=sta.boot,
        board_epoch=stop.epoch,
        bridge_epoch=gate.permit_epoch,
        comm_life=gate.life,
        stop_ids=tuple(held),
        stop_names=tuple(held.values()),
        button_pressed=bool(stop.latched & StopSourceFlag.PRESSED),
    )


def error_code(number: int) -> ErrorCode:
    """The code with that number; a number that is not in the table comes from a firmware newer than this program."""
    try:
        return ErrorCode(number)
    except ValueError:
        return ErrorCode.INTERNAL


def sim_status(sta: SimSta, t_s: float, heartbeat_count: int) -> Status:
    ready = sta.state == SimState.RUNNING
    tilt = f"pitch_deg={sta.pitch_cdeg / 100:.1f} roll_deg={sta.roll_cdeg / 100:.1f}"
    detail = f"free_ram={sta.free_ram} bad_lines={sta.bad_lines} {tilt}"
    return Status(
        t_s, SimState(sta.state).name, error_code(sta.error), sta.free_ram // 1024, ready, heartbeat_count, detail
    )


def car_status(sta: CarSta, t_s: float, heartbeat_count: int, free_ram: int) -> Status:
    ready = sta.state not in (CarState.BOOT, CarState.FAULT)
    detail = f"free_ram={free_ram} battery_mv={sta.battery_mv}"
    return Status(
        t_s, CarState(sta.state).name, error_code(sta.error), free_ram // 1024, ready, heartbeat_count, detail
    )


def drive_line(command: DriveCommand) -> Drv:
    yaw_cdeg = round(degrees(command.yaw_rad) * 100.0) % 36000
    return Drv(command.boot, command.command_id, int(command.speed), yaw_cdeg)
