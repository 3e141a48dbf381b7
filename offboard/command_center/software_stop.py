"""The operator's side of the software stop, for the Command Center and the verbs `estop` and `release`. Pure.

A demand stands until the robot confirms it: `request` says what to send meanwhile, every REPEAT_S. The robot owns the
latch; what it reports with its age (`RobotReport`), and not what was sent, decides what a person sees (`look`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import inf

from common.bus import Bus
from common.messages import ODOMETRY, PERMIT, StopRequest

SOURCE = "operator"
REPEAT_S = 0.02  # the first word of a program that has just joined may get lost
LINK_LOST_S = 1.0
RELEASE_TIMEOUT_S = 5.0


class Demand(Enum):
    NONE = "nothing is asked of the robot"
    STOP = "a stop that is not confirmed yet"
    RELEASE = "a release that is not confirmed yet"


class Look(Enum):
    """What there is to be seen of the stop."""

    IDLE = "no stop"
    SENT = "sent, not confirmed"
    LATCHED = "the robot holds it"
    LINK_LOST = "nothing is heard of the robot"


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What the robot said last about its stop and its wheels, and when that arrived here."""

    stop_sources: tuple[str, ...] = ()
    permit_s: float = -inf
    standing: bool = False
    speed_m_s: float = 0.0
    odometry_s: float = -inf

    def linked(self, now_s: float) -> bool:
        """comm, through which the robot speaks, was heard a moment ago."""
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


def robot_report(bus: Bus, now_s: float) -> RobotReport:
    """The report as the newest messages give it."""
    permit, odometry = bus.latest(PERMIT), bus.latest(ODOMETRY)
    return RobotReport(
        stop_sources=permit.stop_sources if permit is not None else (),
        permit_s=now_s - bus.age_s(PERMIT),
        standing=odometry is not None and odometry.standing,
        speed_m_s=odometry.speed_m_s if odometry is not None else 0.0,
        odometry_s=now_s - bus.age_s(ODOMETRY),
    )


def confirmed(report: RobotReport, since_s: float) -> bool:
    """Latched by the operator and the wheels at rest, both said after `since_s`."""
    latched = report.permit_s > since_s and SOURCE in report.stop_sources
    return latched and report.odometry_s > since_s and report.standing


def pressed(control: StopControl, report: RobotReport, now_s: float) -> StopControl:
    """Somebody wants the robot to stop. To press again changes nothing: not the latency, not a confirmed stop."""
    if control.demand is Demand.STOP:
        return control
    stopped = report.linked(now_s) and report.wheels_known(now_s) and confirmed(report, -inf)
    if control.demand is Demand.NONE and stopped:
        return control
    return StopControl(Demand.STOP, now_s)


def release_hindrance(control: StopControl, report: RobotReport, now_s: float) -> str:
    """Why the stop must not be released now, as one sentence; empty where it may be."""
    if not report.linked(now_s):
        return "The robot is not heard: wait until the link is back."
    if control.demand is Demand.STOP:
        return "The stop is not confirmed yet: wait until it is."
    others = [source for source in report.stop_sources if source != SOURCE]
    if others:
        return f"The robot is also stopped by {', '.join(others)}: clear that first."
    if SOURCE not in report.stop_sources:
        return "No stop of the operator is latched."
    return ""


def release_asked(control: StopControl, report: RobotReport, now_s: float) -> StopControl:
    """Somebody wants the operator's stop released; nothing changes where that must not be."""
    if control.demand is Demand.RELEASE or release_hindrance(control, report, now_s):
        return control
    return StopControl(Demand.RELEASE, now_s)


def heard(control: StopControl, report: RobotReport, now_s: float) -> StopControl:
    """The demand in the light of the robot's newest words."""
    if control.demand is Demand.STOP and confirmed(report, control.since_s):
        return StopControl(latency_s=max(report.permit_s, report.odometry_s) - control.since_s)
    if control.demand is Demand.RELEASE:
        if report.permit_s > control.since_s and SOURCE not in report.stop_sources:
            return StopControl()
        if now_s - control.since_s > RELEASE_TIMEOUT_S:
            return StopControl(release_failed=True)
    if control.demand is Demand.NONE and control.latency_s is not None:
        gone = report.linked(now_s) and SOURCE not in report.stop_sources
        return replace(control, latency_s=None) if gone else control
    return control


def request(control: StopControl, now_s: float) -> StopRequest | None:
    """What to send, now and every REPEAT_S; None where nothing is demanded."""
    if control.demand is Demand.NONE:
        return None
    return StopRequest(now_s, SOURCE, latched=control.demand is Demand.STOP)


def look(control: StopControl, report: RobotReport, now_s: float) -> Look:
    """What to show. A stop is shown as latched only on the robot's own and fresh word."""
    if not report.linked(now_s):
        return Look.LINK_LOST
    if control.demand is Demand.STOP:
        return Look.SENT
    return Look.LATCHED if report.stop_sources else Look.IDLE
