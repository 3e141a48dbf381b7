"""The operator's side of the software stop, for the Command Center and the verbs `estop` and `release`. Pure.

A demand stands until the robot confirms it: `request` returns what to send meanwhile, every REPEAT_S. A press has a
number of its own, which the permit quotes once it is latched; a release names the epoch that the person saw. The robot
owns the stop; what it reports with its age (`RobotReport`), and not what was sent, decides what a person sees (`look`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import inf

from common.bus import Bus
from common.messages.stop import Permit, StopRequest
from common.messages.topics import CARRIER, ODOMETRY, PERMIT
from offboard.operate.stop_press import SOURCE

LINK_LOST_S = 1.0
RELEASE_TIMEOUT_S = 5.0
STANDING_M_S = 0.01
NO_PERMIT = Permit(0.0, False, "")  # before the first one came: its stop epoch is not known


class Demand(Enum):
    NONE = "nothing is demanded of the robot"
    STOP = "a stop that is not confirmed yet"
    RELEASE = "a release that is not confirmed yet"


class Look(Enum):
    """What there is to be seen of the stop."""

    IDLE = "no stop"
    SENT = "sent, not confirmed"
    LATCHED = "the robot holds it"
    UNKNOWN = "comm was started, and waits for what the Arduino knows"
    RELEASED = "released, nothing moves before a resume"
    LINK_LOST = "nothing arrives from the robot"


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What the robot reported last about its stop and its wheels, and when that arrived here."""

    permit: Permit = NO_PERMIT
    permit_s: float = -inf
    standing: bool = False
    speed_m_s: float = 0.0
    odometry_s: float = -inf
    board_epoch: int = 0  # the newest stop that the board knows
    board_stands: bool = False  # its motors are off and its wheels at rest, reported with that epoch
    button_pressed: bool = False

    def linked(self, now_s: float) -> bool:
        """A permit of comm, which reports for the robot, came a moment ago."""
        return now_s - self.permit_s <= LINK_LOST_S

    def wheels_known(self, now_s: float) -> bool:
        return now_s - self.odometry_s <= LINK_LOST_S


@dataclass(frozen=True, slots=True)
class StopControl:
    """What is demanded since when, and how the last demand ended."""

    demand: Demand = Demand.NONE
    since_s: float = 0.0
    latency_s: float | None = None  # from the press to the confirmation, of the stop that is latched now
    release_failed: bool = False
    stop_id: int = 0  # of the press
    epoch: int = 0  # what shall be released


def robot_report(bus: Bus, now_s: float) -> RobotReport:
    """The report as the newest messages give it."""
    permit, odometry, carrier = bus.latest(PERMIT) or NO_PERMIT, bus.latest(ODOMETRY), bus.latest(CARRIER)
    report = RobotReport(permit, now_s - bus.age_s(PERMIT), odometry_s=now_s - bus.age_s(ODOMETRY))
    if odometry is not None:
        report = replace(report, standing=odometry.standing, speed_m_s=odometry.speed_m_s)
    if carrier is not None:
        stands = not carrier.enabled and abs(carrier.speed_m_s) < STANDING_M_S
        report = replace(
            report, board_epoch=carrier.board_epoch, board_stands=stands, button_pressed=carrier.button_pressed
        )
    return report


def confirmed(report: RobotReport, control: StopControl) -> bool:
    """comm has latched this very press, the board knows that stop, and the wheels are at rest since."""
    latched = control.stop_id in report.permit.stop_ids and 0 < report.permit.stop_epoch <= report.board_epoch
    return latched and report.board_stands and report.standing and report.odometry_s > control.since_s


def pressed(control: StopControl, now_s: float, stop_id: int) -> StopControl:
    """A person wants the robot to stop, whatever its state; a press that is still being sent goes on as it was."""
    return control if control.demand is Demand.STOP else StopControl(Demand.STOP, now_s, stop_id=stop_id)


def release_hindrance(control: StopControl, report: RobotReport, now_s: float) -> str:
    """Why the stop must not be released now, as one sentence; empty where it may be."""
    if not report.linked(now_s):
        return "No message from the robot arrives: wait until the link is back."
    if control.demand is Demand.STOP:
        return "The stop is not confirmed yet: wait until it is."
    if report.permit.stop_epoch == 0:
        return "The Arduino has not reported yet which stop it knows: check bridge and USB cable, then try again."
    if not report.permit.stop_sources:
        return "No stop is latched."
    if report.button_pressed:
        return "The button on the robot is pressed: let it out first."
    return ""


def release_requested(control: StopControl, report: RobotReport, now_s: float) -> StopControl:
    """A person wants the stop that is shown released; nothing changes where that must not be."""
    if control.demand is Demand.RELEASE or release_hindrance(control, report, now_s):
        return control
    return StopControl(Demand.RELEASE, now_s, epoch=report.permit.stop_epoch)


def updated(control: StopControl, report: RobotReport, now_s: float) -> StopControl:
    """The demand after the newest report: unchanged, confirmed or timed out."""
    if control.demand is Demand.STOP and confirmed(report, control):
        return StopControl(latency_s=max(report.permit_s, report.odometry_s) - control.since_s)
    if control.demand is Demand.RELEASE:
        if report.permit.stop_epoch == control.epoch and not report.permit.stop_sources:
            return StopControl()
        if report.permit.stop_epoch > control.epoch or now_s - control.since_s > RELEASE_TIMEOUT_S:
            return StopControl(release_failed=True)
    if control.demand is Demand.NONE and control.latency_s is not None:
        gone = report.linked(now_s) and report.permit.stop_epoch > 0 and not report.permit.stop_sources
        return replace(control, latency_s=None) if gone else control
    return control


def request(control: StopControl, now_s: float) -> StopRequest | None:
    """What to send, now and every REPEAT_S; None where nothing is demanded."""
    if control.demand is Demand.NONE:
        return None
    latched = control.demand is Demand.STOP
    return StopRequest(now_s, SOURCE, latched, stop_id=control.stop_id, epoch=control.epoch)


def look(control: StopControl, report: RobotReport, now_s: float) -> Look:
    """What to show. A stop is shown as latched only on a fresh report of the robot."""
    if not report.linked(now_s):
        return Look.LINK_LOST
    if control.demand is Demand.STOP:
        return Look.SENT
    if report.permit.stop_sources:
        return Look.LATCHED
    if report.permit.stop_epoch == 0:
        return Look.UNKNOWN
    return Look.IDLE if report.permit.resumed else Look.RELEASED
