"""Everything that the screen shows at one moment, as one value: made by the node, read by the widgets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from common.messages.mapping import PoseEstimate
from common.messages.mission import PlannerView
from common.messages.motion import CarrierReport
from common.messages.stop import Permit
from common.mission_state import MissionState, mission_state
from common.zones import Zone
from offboard.command_center.board_watch import BoardRow
from offboard.command_center.module_watch import Freshness, ModuleRow
from offboard.operate import alerts
from offboard.operate.operations import Answer
from offboard.operate.software_stop import Look, RobotReport, StopControl, look


@dataclass(frozen=True, slots=True)
class Finding:
    """A point of interest, as the map and `goto` need it."""

    number: str  # that counts: a person's where there is one
    x_m: float
    y_m: float
    room_name: str = ""
    number_read: str = ""
    judged: str = ""  # what a person said of the number, as of common/door_names.py


@dataclass(frozen=True, slots=True)
class OperationResult:
    """The result of the newest command to the mission; `serial` grows with every command."""

    serial: int
    operation: str
    answer: Answer
    sentence: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Ages count to `now_s`, the local monotonic clock; infinite where nothing came."""

    now_s: float
    rows: tuple[ModuleRow, ...] = ()
    boards: tuple[BoardRow, ...] = ()  # that have reported
    control: StopControl = field(default_factory=StopControl)
    report: RobotReport = field(default_factory=RobotReport)
    permit: Permit | None = None
    pose: PoseEstimate | None = None
    pose_age_s: float = float("inf")
    carrier: CarrierReport | None = None
    carrier_age_s: float = float("inf")
    view: PlannerView | None = None
    view_age_s: float = float("inf")
    findings: tuple[Finding, ...] = ()
    zones: tuple[Zone, ...] = ()
    operation: OperationResult | None = None
    lines_dropped: int = 0

    @property
    def look(self) -> Look:
        return look(self.control, self.report, self.now_s)

    @property
    def reasons(self) -> dict[str, str]:
        """Sentence by what it is about, of all that a person should be called for now."""
        rows = [row for row in self.rows if row.freshness is Freshness.LIVE]
        return alerts.reasons(self.view, [(row.module, row.status.error_code) for row in rows if row.status])

    @property
    def mission(self) -> MissionState:
        return mission_state(self.view, self.permit)


@dataclass(frozen=True, slots=True)
class FloorPicture:
    """What the small map is drawn from, in metres of the map's frame."""

    walls_m: npt.NDArray[np.float32]  # (N, 2)
    inferred: npt.NDArray[np.uint8]  # (N,)
    trail_m: npt.NDArray[np.float64]  # (M, 2)
    path_m: npt.NDArray[np.float32]  # (W, 2) what the Planner wants to drive
    findings: tuple[Finding, ...]
    pose: PoseEstimate | None
    pose_live: bool
    zones: tuple[Zone, ...] = ()
