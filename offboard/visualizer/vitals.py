"""What a person watches beside the map: battery, speed, time left, how well the robot is received, modules' health.

Messages and their times of arrival -> `Vitals`. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.messages.health import Status
from common.messages.mapping import PoseEstimate
from common.messages.mission import PlannerView
from common.messages.motion import CarrierReport
from offboard.operate.health_history import HealthHistory, Sample
from offboard.visualizer.link_quality import LinkQuality
from offboard.visualizer.time_left import TimeLeft


@dataclass(frozen=True, slots=True)
class Figures:
    """None where nothing is known."""

    battery_v: float | None
    speed_m_s: float | None  # over the last minutes, with looks and turns
    left_s: float | None
    received_share: float | None  # of the newest poses
    longest_gap_s: float | None


class Vitals:
    """`take_...` as it comes."""

    def __init__(self) -> None:
        self._carrier: CarrierReport | None = None
        self._link, self._left = LinkQuality(), TimeLeft()
        self._histories: dict[str, HealthHistory] = {}

    def take_pose(self, pose: PoseEstimate, arrived_s: float) -> None:
        self._link.add(pose.t_s, arrived_s)
        self._left.take_pose(pose)

    def take_plan(self, plan: PlannerView) -> None:
        self._left.take_plan(plan)

    def take_carrier(self, carrier: CarrierReport) -> None:
        self._carrier = carrier

    def take_status(self, module: str, status: Status, arrived_s: float) -> bool:
        """Whether `health` of that module is another now."""
        history = self._histories.setdefault(module, HealthHistory())
        before = history.samples
        history.add(status, arrived_s)
        return history.samples is not before

    def figures(self) -> Figures:
        battery_v = self._carrier.battery_v if self._carrier is not None else None
        left, link = self._left, self._link
        return Figures(battery_v, left.speed_m_s, left.seconds, link.share, link.longest_gap_s)

    def health(self) -> dict[str, tuple[Sample, ...]]:
        """By module, oldest first."""
        return {module: history.samples for module, history in self._histories.items() if history.samples}
