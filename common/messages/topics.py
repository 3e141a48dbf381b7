"""The topic table: one line per variable on the bus, with its rate, QoS profile and consumers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Generic, TypeVar

from common.constants import (
    BOARD_RATE_HZ,
    MAP_RATE_MAX_HZ,
    PERMIT_RATE_HZ,
    POSE_RATE_HZ,
    SENSOR_RATE_HZ,
    STATUS_RATE_HZ,
)
from common.messages.delivery import OutboxPiece, OutboxReceipt
from common.messages.health import BoardState, ClockAck, ClockTick, LogLine, Status
from common.messages.mapping import GridUpdate, MapUpdate, PoseEstimate, Trajectory
from common.messages.mission import OperatorCommand, PlannerView, PoseAnswer, Zones
from common.messages.motion import CarrierReport, Distances, DriveCommand, Odometry, Ranges
from common.messages.points_of_interest import DoorStatement, DoorStatements, PointOfInterest, PoiRequest
from common.messages.stop import Permit, StopRequest
from common.modules import MODULES, OFFBOARD, OPTIONAL, ROBOT_SENDERS, publisher_of


class QosProfile(Enum):
    """How a topic travels, and why."""

    LATEST = "newest wins, older ones are dropped: an old reading is worth nothing once a newer one is there"
    COMMAND = "real-time priority, repeated until acknowledged: it must arrive, and soon"
    EVENT = "reliable and in order, through the outbox: nothing may be lost"
    STATE = "a snapshot, answered to a query too: who joins late or missed some must be able to catch up"
    BULK = "lowest priority, a piece at a time, sent again until acknowledged: what is stored must not delay what lives"


P = TypeVar("P")


@dataclass(frozen=True)
class Topic(Generic[P]):
    """One line of the table. `rate_hz` 0 = on event."""

    key: str  # <module>/<variable>, the module being the producer
    payload: type[P]
    rate_hz: float
    qos: QosProfile
    consumers: tuple[str, ...]
    flows: tuple[str, ...] = ()  # the specification's names
    note: str = ""

    @property
    def producer(self) -> str:
        return self.key.split("/")[0]

    @cached_property
    def bundle_key(self) -> str:
        """Where its messages travel, together with others of the same step; empty where each travels by itself."""
        periodic = self.rate_hz > 0.0 and self.qos in (QosProfile.LATEST, QosProfile.COMMAND)
        return f"{publisher_of(self.producer)}/bundle" if periodic else ""

    @property
    def recorded(self) -> bool:
        """Every message of it belongs into the run database."""
        return "recorder" in self.consumers and self.qos is not QosProfile.BULK

    @property
    def is_command(self) -> bool:
        """A person's command to the robot: only the command center publishes it."""
        return self.producer == "command_center" and self.qos is QosProfile.COMMAND


_TOPICS: dict[str, Topic[object]] = {}


def _topic(
    key: str, payload: type[P], rate_hz: float, qos: QosProfile, consumers: str, flows: str = "", note: str = ""
) -> Topic[P]:
    topic = Topic(key, payload, rate_hz, qos, tuple(consumers.split()), tuple(flows.split()), note)
    _TOPICS[key] = topic  # type: ignore[assignment]
    return topic


# What stands on the laptop shows and stores it for people
PEOPLE = " ".join(name for name in OFFBOARD if name not in OPTIONAL)
AT_ONCE = "and at once on change"

ODOMETRY = _topic(
    "bridge/odometry", Odometry, SENSOR_RATE_HZ, QosProfile.LATEST, "mmu planner recorder command_center", "lfc_sim_mmu"
)
RANGES = _topic(
    "bridge/ranges", Ranges, SENSOR_RATE_HZ, QosProfile.LATEST, "mmu planner poi recorder visualizer ros", "lfc_sim_mmu"
)
DISTANCES = _topic("bridge/distances", Distances, SENSOR_RATE_HZ, QosProfile.LATEST, "planner recorder", "lfc_sim_pln")
CARRIER = _topic(
    "bridge/carrier",
    CarrierReport,
    SENSOR_RATE_HZ,
    QosProfile.LATEST,
    "planner comm recorder command_center visualizer",
    "lfc_pln_car",
    AT_ONCE,
)
DRIVE = _topic(
    "planner/drive", DriveCommand, SENSOR_RATE_HZ, QosProfile.COMMAND, "bridge recorder", "lfc_pln_car", AT_ONCE
)
POSE = _topic(
    "mmu/pose",
    PoseEstimate,
    POSE_RATE_HZ,
    QosProfile.LATEST,
    f"planner poi {PEOPLE} ros",
    "lfc_mmu_poi lfc_mmu_pln lfc_mmu_cm",
)
MAP = _topic(
    "mmu/map",
    MapUpdate,
    MAP_RATE_MAX_HZ,
    QosProfile.STATE,
    f"planner poi {PEOPLE}",
    "lfc_mmu_pln lfc_mmu_cm lfc_cm_vsl",
    "on change",
)
GRID = _topic(
    "mmu/grid", GridUpdate, MAP_RATE_MAX_HZ, QosProfile.STATE, "planner poi visualizer ros", "lfc_mmu_pln", "on change"
)
TRAJECTORY = _topic(
    "mmu/trajectory",
    Trajectory,
    0.0,
    QosProfile.STATE,
    f"poi {PEOPLE} ros",
    "lfc_mmu_poi lfc_mmu_cm",
    "when the past was corrected",
)
POSE_ANSWER = _topic(
    "mmu/pose_answer", PoseAnswer, 0.0, QosProfile.STATE, "recorder command_center", note="to a pose that was stated"
)
PLAN = _topic("planner/view", PlannerView, MAP_RATE_MAX_HZ, QosProfile.STATE, PEOPLE, note="for people")
ZONES = _topic("planner/zones", Zones, 0.0, QosProfile.STATE, PEOPLE, note="on change, and after each start")
RETAKE = _topic("poi/request", PoiRequest, 0.0, QosProfile.COMMAND, "planner recorder", "lfc_poi_pln")
POI = _topic("poi/record", PointOfInterest, 0.0, QosProfile.EVENT, f"{PEOPLE} ros", "lfc_poi_cm lfc_cm_vsl")
PERMIT = _topic("comm/permit", Permit, PERMIT_RATE_HZ, QosProfile.COMMAND, f"bridge planner poi {PEOPLE}", note=AT_ONCE)
STOP = _topic("command_center/stop", StopRequest, 0.0, QosProfile.COMMAND, "bridge comm recorder", "lfc_cm_cc")
OPERATION = _topic("command_center/operation", OperatorCommand, 0.0, QosProfile.COMMAND, "planner mmu comm recorder")
DOOR = _topic("command_center/door", DoorStatement, 0.0, QosProfile.COMMAND, "recorder")
DOOR_NOTES = _topic(
    "recorder/doors", DoorStatements, 0.0, QosProfile.STATE, "visualizer command_center", note="on change"
)
OUTBOX = _topic(
    "comm/outbox", OutboxPiece, 0.0, QosProfile.BULK, "recorder", note="what the robot has for the run database"
)
RECEIPT = _topic(
    "recorder/receipt", OutboxReceipt, 0.0, QosProfile.LATEST, "comm", note="on progress, else every second"
)
CLOCK = _topic("clock/time", ClockTick, 0.0, QosProfile.COMMAND, "", note="only under `local --speed`")
CLOCK_ACK = _topic("clock/ack", ClockAck, 0.0, QosProfile.COMMAND, "", note="only under `local --speed`")

# Who reports for the board that it runs on
BOARD: dict[str, Topic[BoardState]] = {
    module: _topic(f"{module}/board", BoardState, BOARD_RATE_HZ, QosProfile.LATEST, "command_center")
    for module in ("comm", "poi")
}
STATUS: dict[str, Topic[Status]] = {}
LOG: dict[str, Topic[LogLine]] = {}
for _module in (module.name for module in MODULES):
    _flows = "lfc_cm_cc lfc_vsl_cc" if _module == "visualizer" else "lfc_cm_cc"
    STATUS[_module] = _topic(f"{_module}/status", Status, STATUS_RATE_HZ, QosProfile.LATEST, f"comm {PEOPLE}", _flows)
    LOG[_module] = _topic(f"{_module}/log", LogLine, 0.0, QosProfile.EVENT, "recorder command_center", _flows)

TOPICS: tuple[Topic[object], ...] = tuple(_TOPICS.values())

# Flows that never touch the bus
INTERNAL_FLOWS: dict[str, str] = {"lfc_sim_car": "program memory of the Arduino: SIM and Carrier share one program"}

ROBOT_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer in ROBOT_SENDERS)  # through the outbox
LAPTOP_RECORDED = tuple(t for t in TOPICS if t.recorded and t.producer not in ROBOT_SENDERS)
